"use strict";

/* Two pictures of a section, compared by a slider or by flipping; exposure, zoom, and the radiance of a pixel.
   The pictures come from the cards; those with full range are drawn from it, others as they are. */

/* A card's radiance as embed.py packs it: per channel the differences of half floats, high bytes, then low. */
async function unpack(card, width, height) {
  const holder = card.querySelector(".radiance");
  if (!holder || !("DecompressionStream" in window)) return null;
  const packed = Uint8Array.from(atob(holder.textContent), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = width * height;
  return [0, 1, 2].map((channel) => {
    const high = bytes.subarray(2 * channel * count);
    const low = bytes.subarray((2 * channel + 1) * count);
    const halves = new Uint16Array(count);
    for (let i = 0, sum = 0; i < count; i++) halves[i] = sum = (sum + (high[i] << 8) + low[i]) & 0xffff;
    return halves;
  });
}

function fromHalf(bits) {
  const exponent = (bits >> 10) & 31, fraction = bits & 1023;
  return exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -24 * fraction;
}

/* The sRGB byte of every half float at an exposure in stops. */
const tones = new Map();
function toneTable(stops) {
  if (!tones.has(stops)) {
    if (tones.size > 8) tones.clear();
    const table = new Uint8ClampedArray(65536);
    for (let bits = 0; bits < 0x7c00; bits++) {
      const x = Math.min(fromHalf(bits) * 2 ** stops, 1);
      table[bits] = 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
    }
    tones.set(stops, table);
  }
  return tones.get(stops);
}

class Compare {
  constructor(section) {
    const find = (name) => section.querySelector(name);
    this.section = section;
    this.stage = find(".stage");
    this.cards = [...section.querySelectorAll(".card")];
    const first = this.cards[0].querySelector("img");
    this.width = +first.getAttribute("width");
    this.height = +first.getAttribute("height");
    this.canvases = { left: find("canvas.left"), right: find("canvas.right") };
    this.choices = { left: find(".left-choice"), right: find(".right-choice") };
    this.split = find(".split");
    this.exposure = find(".exposure input");
    this.readout = find(".readout");
    this.mode = "slide";
    this.zoom = 1;
    this.origin = [0, 0]; /* of the view, as shares of the picture */
    this.flipped = false;
  }

  async start() {
    this.radiance = await Promise.all(this.cards.map((card) => unpack(card, this.width, this.height)));
    this.stage.style.aspectRatio = `${this.width} / ${this.height}`;
    this.cards.forEach((card, index) => {
      for (const choice of Object.values(this.choices)) choice.add(new Option(card.dataset.label, index));
    });
    for (const [side, initial] of Object.entries({ left: 0, right: 1 })) {
      this.canvases[side].width = this.width;
      this.canvases[side].height = this.height;
      this.choices[side].value = Math.min(initial, this.cards.length - 1);
      this.choices[side].addEventListener("change", () => this.draw(side));
    }
    this.split.addEventListener("input", () => this.place());
    this.exposure.addEventListener("input", () => this.expose());
    for (const button of this.section.querySelectorAll(".mode")) {
      button.addEventListener("click", () => this.setMode(button.dataset.mode));
    }
    this.section.querySelector(".in").addEventListener("click", () => this.zoomTo(this.zoom * 2));
    this.section.querySelector(".out").addEventListener("click", () => this.zoomTo(this.zoom / 2));
    this.section.querySelector(".reset").addEventListener("click", () => this.reset());
    this.listen();
    this.section.querySelector(".compare").hidden = false;
    this.section.classList.add("with-viewer"); /* which shows the plain pictures: their cards can go */
    this.expose();
    this.place();
  }

  listen() {
    let drag = null;
    this.stage.addEventListener("pointerdown", (event) => {
      drag = { x: event.clientX, y: event.clientY, origin: [...this.origin], moved: false };
      this.stage.setPointerCapture(event.pointerId);
      if (this.mode === "slide" && this.zoom === 1) this.splitAt(event);
    });
    this.stage.addEventListener("pointermove", (event) => {
      this.read(event);
      if (!drag) return;
      const box = this.stage.getBoundingClientRect();
      const moved = [(event.clientX - drag.x) / box.width, (event.clientY - drag.y) / box.height];
      drag.moved ||= Math.hypot(event.clientX - drag.x, event.clientY - drag.y) > 4;
      if (this.zoom > 1) {
        this.moveTo(drag.origin.map((start, axis) => start - moved[axis] / this.zoom));
      } else if (this.mode === "slide") {
        this.splitAt(event);
      }
    });
    this.stage.addEventListener("pointerup", () => {
      if (drag && !drag.moved && this.mode === "flip") this.flip();
      drag = null;
    });
    this.stage.addEventListener("pointercancel", () => { drag = null; });
    this.stage.addEventListener("dblclick", (event) => this.zoomTo(this.zoom * 2, this.at(event)));
    this.stage.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return; /* the wheel alone scrolls the page */
      event.preventDefault();
      this.zoomTo(this.zoom * 2 ** (-event.deltaY / 200), this.at(event));
    }, { passive: false });
    this.section.addEventListener("keydown", (event) => {
      if (event.key.toLowerCase() !== "f" || event.ctrlKey || event.metaKey) return;
      if (event.target.tagName === "SELECT") return;
      if (this.mode !== "flip") this.setMode("flip"); else this.flip();
    });
  }

  /* Where an event is, as shares of the stage. */
  within(event) {
    const box = this.stage.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  /* Where an event is, as shares of the picture. */
  at(event) {
    return this.within(event).map((share, axis) => this.origin[axis] + share / this.zoom);
  }

  splitAt(event) {
    this.split.value = 100 * this.within(event)[0];
    this.place();
  }

  draw(side) {
    const index = +this.choices[side].value, card = this.cards[index], canvas = this.canvases[side];
    const context = canvas.getContext("2d"), channels = this.radiance[index];
    if (channels) {
      const table = toneTable(+this.exposure.value);
      const pixels = context.createImageData(this.width, this.height);
      for (let i = 0; i < this.width * this.height; i++) {
        for (let channel = 0; channel < 3; channel++) pixels.data[4 * i + channel] = table[channels[channel][i]];
        pixels.data[4 * i + 3] = 255;
      }
      context.putImageData(pixels, 0, 0);
    } else {
      const image = new Image();
      image.onload = () => {
        if (+this.choices[side].value !== index) return;
        context.clearRect(0, 0, this.width, this.height);
        context.drawImage(image, 0, 0, this.width, this.height);
      };
      image.src = card.querySelector("img").src;
    }
    this.stage.querySelector(`.${side}-tag`).textContent = card.dataset.label;
  }

  expose() {
    const stops = +this.exposure.value;
    this.section.querySelector(".exposure output").textContent = `${stops > 0 ? "+" : ""}${stops} EV`;
    this.draw("left");
    this.draw("right");
  }

  setMode(mode) {
    this.mode = mode;
    this.flipped = false;
    for (const button of this.section.querySelectorAll(".mode")) {
      button.setAttribute("aria-pressed", button.dataset.mode === mode);
    }
    this.place();
  }

  flip() {
    this.flipped = !this.flipped;
    this.place();
  }

  reset() {
    this.exposure.value = 0;
    this.expose();
    this.zoomTo(1);
  }

  zoomTo(zoom, [x, y] = this.origin.map((start) => start + 0.5 / this.zoom)) {
    const before = this.zoom;
    this.zoom = Math.min(Math.max(zoom, 1), 32);
    this.moveTo([x, y].map((to, axis) => to - (to - this.origin[axis]) * before / this.zoom));
  }

  moveTo(origin) {
    this.origin = origin.map((start) => Math.min(Math.max(start, 0), 1 - 1 / this.zoom));
    this.place();
  }

  place() {
    const slide = this.mode === "slide";
    this.stage.dataset.mode = this.mode;
    this.stage.dataset.shown = slide ? "both" : this.flipped ? "right" : "left";
    this.stage.style.setProperty("--split", slide ? `${this.split.value}%` : this.flipped ? "0%" : "100%");
    this.split.disabled = !slide;
    this.stage.classList.toggle("zoomed", this.zoom > 1);
    const [x, y] = this.origin, scale = 100 * this.zoom;
    for (const canvas of Object.values(this.canvases)) {
      canvas.style.width = canvas.style.height = `${scale}%`;
      canvas.style.left = `${-x * scale}%`;
      canvas.style.top = `${-y * scale}%`;
    }
    const split = slide ? this.split.value / 100 : this.flipped ? 0 : 1; /* a share of the stage */
    const end = (x + split / this.zoom) * 100;
    this.canvases.left.style.clipPath = `inset(0 ${100 - end}% 0 0)`;
    this.section.querySelector(".zooms output").textContent = `${Math.round(scale)} %`;
  }

  read(event) {
    const [x, y] = this.at(event);
    const column = Math.floor(x * this.width), row = Math.floor(y * this.height);
    if (column < 0 || row < 0 || column >= this.width || row >= this.height) return;
    const known = this.cards.flatMap((card, index) => (this.radiance[index] ? [index] : []));
    const values = known.map((index) => this.radiance[index].map((plane) => fromHalf(plane[row * this.width + column])));
    this.readout.replaceChildren();
    const add = (name, text) => {
      const line = document.createElement("span");
      line.className = "pixel";
      const label = document.createElement("b");
      label.textContent = name;
      line.append(label, text);
      this.readout.append(line);
    };
    add("pixel", `row ${row}, column ${column}`);
    const name = this.cards[known[0]].dataset.label;
    const own = values[0].reduce((sum, part) => sum + part, 0);
    known.forEach((index, i) => {
      const other = values[i].reduce((sum, part) => sum + part, 0);
      const more = (own / other - 1) * 100;
      const off = i === 0 || other === 0 ? "" : `\n${name} ${more < 0 ? "−" : "+"}${Math.abs(more).toFixed(2)} %`;
      add(this.cards[index].dataset.label, values[i].map((value) => value.toPrecision(4)).join("  ") + off);
    });
  }
}

for (const section of document.querySelectorAll("section.viewer")) new Compare(section).start();
