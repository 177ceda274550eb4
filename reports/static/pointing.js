// Helps for tables of links: one tooltip for all cells, and arrow keys from cell to cell.
"use strict";

// Shows the lines that say(link) gives when a link of a table is pointed at or has the focus; Escape hides them.
function tooltip(table, say) {
  const tip = Object.assign(document.createElement("div"), { id: "tooltip", className: "tooltip", hidden: true });
  tip.setAttribute("role", "tooltip");
  document.body.append(tip);
  let shown = null; // the link that the tooltip is of

  function show(link) {
    hide();
    const lines = link ? say(link) : [];
    if (!lines.length) return;
    shown = link;
    tip.replaceChildren(...lines.map((text) => Object.assign(document.createElement("span"), { className: "line", textContent: text })));
    tip.hidden = false;
    link.setAttribute("aria-describedby", tip.id);
    place();
  }

  function place() {
    const box = shown.getBoundingClientRect();
    tip.style.left = `${Math.max(8, Math.min(box.left, document.documentElement.clientWidth - tip.offsetWidth - 8))}px`;
    const below = box.bottom + 4;
    tip.style.top = `${below + tip.offsetHeight < innerHeight ? below : Math.max(8, box.top - tip.offsetHeight - 4)}px`;
  }

  function hide() {
    tip.hidden = true;
    shown?.removeAttribute("aria-describedby");
    shown = null;
  }

  // To a link that takes the focus the page scrolls by itself: then the tooltip follows.
  function follow() {
    if (shown && shown === document.activeElement) place();
    else hide();
  }

  table.addEventListener("mouseover", (event) => show(event.target.closest("a")));
  table.addEventListener("mouseleave", hide);
  table.addEventListener("focusin", (event) => show(event.target.closest("a")));
  table.addEventListener("focusout", hide);
  document.addEventListener("scroll", follow, { passive: true, capture: true });
  document.addEventListener("keydown", (event) => event.key === "Escape" && hide());
}

// Makes a table one stop of the Tab key, within which arrow keys, Home and End move. Returns what is to be called after rows
// or columns were moved or hidden.
function arrows(table) {
  const KEYS = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"];
  const within = (row) => [...row.querySelectorAll(":scope > :not([hidden]) :is(a, button)")];
  const visible = () => [...table.rows].filter((row) => !row.hidden);
  let stop = null;

  function rove(to) {
    for (const each of table.querySelectorAll("a, button")) each.tabIndex = -1;
    stop = to ?? null;
    if (stop) stop.tabIndex = 0;
  }

  function next(from, key, far) {
    const tr = from.closest("tr");
    if (key === "ArrowUp" || key === "ArrowDown") {
      const rows = visible();
      const row = rows[rows.indexOf(tr) + (key === "ArrowDown" ? 1 : -1)];
      return row?.cells[from.closest("th, td").cellIndex].querySelector("a, button");
    }
    const all = far ? visible().flatMap(within) : within(tr);
    const at = all.indexOf(from);
    return { ArrowLeft: all[at - 1], ArrowRight: all[at + 1], Home: all[0], End: all.at(-1) }[key];
  }

  table.setAttribute("role", "grid");
  table.addEventListener("keydown", (event) => {
    if (!KEYS.includes(event.key) || event.altKey || event.metaKey) return;
    const to = next(event.target, event.key, event.ctrlKey);
    if (!to) return;
    event.preventDefault();
    rove(to);
    to.focus();
  });
  return () => rove(stop?.checkVisibility() ? stop : visible().flatMap(within)[0]);
}
