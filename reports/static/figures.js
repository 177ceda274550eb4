// Legends of figures, which highlight and hide series, and figures to take along as SVG and PNG.
//
// The address says hide=<names>, the series that were hidden, and with=<names>, those shown beyond the first ones of a figure
// with many, or with=all. Both hold for all figures of a page; series that are not shown are folded away in the legends of such
// figures. Without scripts every series is shown.
"use strict";

const legends = () => {
  const figures = [...document.querySelectorAll("figure")].filter((figure) => figure.querySelector(".key"));
  if (!figures.length) return;
  const list = (key) => (address.get(key) ?? "").split(",").filter(Boolean);
  const button = (words, press) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = words;
    made.addEventListener("click", press);
    return made;
  };

  function shown(item) {
    const [hidden, more] = [list("hide"), list("with")];
    if (hidden.includes(item.dataset.name)) return false;
    return !("later" in item.dataset) || more.includes("all") || more.includes(item.dataset.name);
  }

  function toggle(item) {
    const name = item.dataset.name;
    const [hidden, more] = ["hide", "with"].map((key) => list(key).filter((other) => other !== name));
    if (shown(item)) hidden.push(name);
    else if (document.querySelector(`[data-later][data-name="${name}"]`)) more.push(name);
    choose({ hide: hidden.join(","), with: more.includes("all") ? "all" : more.join(",") });
  }

  function show() {
    for (const figure of figures) {
      const items = [...figure.querySelectorAll("[data-key]")];
      for (const each of figure.querySelectorAll("[data-all]")) each.hidden = items.every(shown);
      for (const item of items) {
        const on = shown(item);
        item.firstElementChild.setAttribute("aria-pressed", on);
        for (const drawn of figure.querySelectorAll(`[data-series="${item.dataset.key}"]`)) drawn.classList.toggle("off", !on);
      }
    }
  }

  function choose(changes) {
    address.set(changes);
    show();
  }

  function dress(figure) {
    const series = figure.querySelectorAll("[data-series]");
    const only = (key) => series.forEach((drawn) => drawn.classList.toggle("dim", key !== null && drawn.dataset.series !== key));
    for (const item of figure.querySelectorAll("[data-key]")) {
      const entry = button("", () => toggle(item));
      entry.append(...item.childNodes);
      item.append(entry);
      for (const kind of ["mouseenter", "focus"]) entry.addEventListener(kind, () => only(item.dataset.key));
      for (const kind of ["mouseleave", "blur"]) entry.addEventListener(kind, () => only(null));
    }
    const tools = document.createElement("p");
    tools.className = "tools";
    const key = figure.querySelector(".key");
    const later = key.querySelectorAll("[data-later]").length;
    const all = button("Show all", () => choose({ hide: null, with: document.querySelector("[data-later]") ? "all" : null }));
    all.dataset.all = "";
    tools.append(all);
    if (later) {
      const more = button(`Choose from ${later} more`, () => more.setAttribute("aria-expanded", !key.classList.toggle("folded")));
      more.setAttribute("aria-expanded", "false");
      key.classList.add("folded");
      tools.prepend(more);
      tools.append(button("Only the first ones", () => choose({ hide: null, with: null })));
    }
    key.after(tools);
  }

  figures.forEach(dress);
  address.follow(show);
};

legends();
