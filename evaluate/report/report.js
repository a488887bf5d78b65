"use strict";

/* The comparison of two pictures of a frame; the pictures come from the cards below it. */
for (const frame of document.querySelectorAll(".frame")) {
  const viewer = frame.querySelector(".viewer");
  const stage = viewer.querySelector(".stage");
  const cards = [...frame.querySelectorAll(".card")];
  const sides = { left: 0, right: 1 };
  for (const [side, first] of Object.entries(sides)) {
    const choice = viewer.querySelector(`.${side}-choice`);
    cards.forEach((card, index) => choice.add(new Option(card.dataset.label, index)));
    const show = () => {
      const card = cards[choice.value];
      stage.querySelector(`img.${side}`).src = card.querySelector("img").src;
      stage.querySelector(`img.${side}`).alt = card.dataset.label;
      stage.querySelector(`.${side}-tag`).textContent = card.dataset.label;
    };
    choice.value = Math.min(first, cards.length - 1);
    choice.addEventListener("change", show);
    show();
  }
  const slider = stage.querySelector("input");
  const split = () => stage.style.setProperty("--split", `${slider.value}%`);
  slider.addEventListener("input", split);
  split();
  viewer.hidden = false;
  frame.classList.add("with-viewer"); /* which shows the plain pictures: their cards can go */
}

/* The sequence as a small player over its strip of frames. */
for (const film of document.querySelectorAll(".film")) {
  const player = film.querySelector(".player");
  const strip = film.querySelector(".strip");
  const pictures = [...strip.querySelectorAll("img")];
  const slider = player.querySelector("input");
  const button = player.querySelector(".play");
  let timer = null;

  const show = (index) => {
    slider.value = index;
    player.querySelector(".screen").src = pictures[index].src;
    player.querySelector("output").textContent = `frame ${pictures[index].dataset.index}`;
    pictures.forEach((picture, other) => picture.classList.toggle("current", other === index));
  };
  const stop = () => {
    clearInterval(timer);
    timer = null;
    button.textContent = "Play";
  };
  const play = () => {
    timer = setInterval(() => show((+slider.value + 1) % pictures.length), 1000 / strip.dataset.fps);
    button.textContent = "Pause";
  };

  button.addEventListener("click", () => (timer === null ? play() : stop()));
  slider.addEventListener("input", () => { stop(); show(+slider.value); });
  pictures.forEach((picture, index) => picture.addEventListener("click", () => { stop(); show(index); }));
  show(0);
  player.hidden = false;
}
