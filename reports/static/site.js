// The choice of the metric on the overview, tooltips, the highlighting of a line in a figure, and unfolding for a link.
"use strict";

const PARTS = ["value", "unit", "interval", "mark", "runs", "note"];

function chooser() {
  const source = document.getElementById("matrix-data");
  const select = document.getElementById("choice");
  if (!source || !select) return;
  const data = JSON.parse(source.textContent);
  const rows = [...document.querySelectorAll(".matrix tbody tr")].map((tr) => [...tr.querySelectorAll("[data-cell]")]);

  function fill(td, [state, value, unit, interval, mark, runs, shade, note]) {
    const shown = { value, unit, interval, mark, runs, note };
    td.className = `cell ${state.replace(" ", "-")} ${shade}`;
    for (const part of PARTS) td.querySelector(`[data-${part}]`).textContent = shown[part];
    const tip = td.querySelector(".tip");
    tip.hidden = !tip.textContent.trim();
    const link = td.querySelector("a");
    if (!tip.hidden) link.setAttribute("aria-describedby", tip.id);
    else link.removeAttribute("aria-describedby");
  }

  function show(number) {
    const choice = data.choices[number];
    rows.forEach((cells, r) => cells.forEach((td, c) => fill(td, data.shown[data.cells[r][number][c]])));
    document.querySelector("[data-title]").textContent = choice.title;
    document.querySelector("[data-better]").textContent = choice.better;
    document.querySelector("[data-legends]").hidden = !choice.legend.length;
    document.querySelectorAll("[data-legend]").forEach((item, i) => { item.textContent = choice.legend[i] ?? ""; });
    select.selectedIndex = number;
  }

  function fromAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1)).get("show");
    if (wanted === null && location.hash) return; // an anchor, no choice
    show(Math.max(0, data.choices.findIndex((choice) => choice.id === wanted)));
  }

  select.addEventListener("change", () => {
    show(select.selectedIndex);
    history.replaceState(null, "", `#show=${data.choices[select.selectedIndex].id}`);
  });
  window.addEventListener("hashchange", fromAddress);
  document.querySelectorAll("[data-needs-script]").forEach((element) => { element.hidden = false; });
  fromAddress();
}

// The skip link moves the focus but leaves the address, which holds the choice.
function skipLink() {
  document.querySelector(".skip").addEventListener("click", (event) => {
    event.preventDefault();
    document.getElementById("main").focus();
  });
}

// A tooltip would be cut off by the box in which its table scrolls, so it is placed on the window.
function tooltips() {
  function place(link) {
    const tip = link.parentElement.querySelector(".tip");
    if (!tip || tip.hidden) return;
    tip.classList.remove("dismissed");
    const box = link.getBoundingClientRect();
    tip.style.position = "fixed";
    tip.style.left = `${Math.max(8, Math.min(box.left, innerWidth - tip.offsetWidth - 8))}px`;
    const below = box.bottom + 4;
    tip.style.top = `${below + tip.offsetHeight < innerHeight ? below : Math.max(8, box.top - tip.offsetHeight - 4)}px`;
  }
  for (const link of document.querySelectorAll(".cell a")) {
    for (const kind of ["mouseenter", "focus"]) link.addEventListener(kind, () => place(link));
  }
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") document.querySelectorAll(".tip").forEach((tip) => tip.classList.add("dismissed"));
  });
}

function highlighting() {
  for (const figure of document.querySelectorAll("figure")) {
    const series = figure.querySelectorAll("[data-series]");
    const only = (key) => series.forEach((g) => g.classList.toggle("dim", key !== null && g.dataset.series !== key));
    for (const item of figure.querySelectorAll("[data-key]")) {
      for (const kind of ["mouseenter", "focus"]) item.addEventListener(kind, () => only(item.dataset.key));
      for (const kind of ["mouseleave", "blur"]) item.addEventListener(kind, () => only(null));
    }
  }
}

// A link to what is folded away unfolds it; newer browsers do so by themselves.
function unfold() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const folded = target?.closest("details:not([open])");
  if (!folded) return;
  folded.open = true;
  target.scrollIntoView();
}

skipLink();
chooser();
tooltips();
highlighting();
unfold();
window.addEventListener("hashchange", unfold);
