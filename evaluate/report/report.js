/* The sequence as a small player over its strip of frames. */
for (const film of document.querySelectorAll("section.film")) {
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

/* Tables sort by the column whose heading is pressed; a third press gives back the order of the report. */
for (const table of document.querySelectorAll("table")) {
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const headings = [...table.querySelectorAll("tr.columns th")];

  const key = (row, column) => {
    const cell = row.cells[column];
    if (cell.dataset.value !== undefined) return +cell.dataset.value;
    return cell.textContent.trim();
  };
  const order = (column, up) => (a, b) => {
    const [x, y] = [key(a, column), key(b, column)];
    if (typeof x !== typeof y) return typeof x === "number" ? -1 : 1; /* what has no value comes last */
    const sign = up ? 1 : -1;
    return typeof x === "number" ? sign * (x - y) : sign * x.localeCompare(y, undefined, { numeric: true });
  };

  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.textContent = heading.textContent || "name";
    heading.replaceChildren(button);
    button.addEventListener("click", () => {
      const next = { none: "descending", descending: "ascending", ascending: "none" };
      const direction = next[heading.getAttribute("aria-sort") ?? "none"];
      headings.forEach((other) => other.removeAttribute("aria-sort"));
      if (direction !== "none") heading.setAttribute("aria-sort", direction);
      const sorted = direction === "none" ? rows : [...rows].sort(order(column, direction === "ascending"));
      body.append(...sorted);
    });
  });
}
