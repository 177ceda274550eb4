// Sorting of tables of the class "sortable" by the buttons in their heads: up, down, and as they were.
//
// A cell counts by its data-sort, a number; where no cell of a column has one, by its text. What is missing comes last.
"use strict";

const sorting = (table) => {
  const columnOf = (cell) => [...cell.parentElement.cells].slice(0, cell.cellIndex).reduce((sum, other) => sum + other.colSpan, 0);
  const bodies = [...table.tBodies].map((body) => ({ body, rows: [...body.rows] }));
  const heads = [...table.tHead.rows].at(-1).cells;

  function at(row, column) {
    let place = 0;
    for (const cell of row.cells) {
      if (place === column) return cell;
      place += cell.colSpan;
    }
    return null; // within a cell over several columns
  }

  function keyOf(row, column, numeric) {
    const cell = at(row, column);
    if (!numeric) return cell?.innerText.trim() || null;
    const value = Number.parseFloat(cell?.dataset.sort?.replace("inf", "Infinity"));
    return Number.isNaN(value) ? null : value;
  }

  function sort(column, direction) {
    const numeric = bodies.some(({ rows }) => rows.some((row) => at(row, column)?.dataset.sort !== undefined));
    const order = (a, b) => (numeric ? a - b : a.localeCompare(b, "en", { numeric: true }));
    for (const { body, rows } of bodies) {
      const keyed = rows.map((row) => ({ row, key: keyOf(row, column, numeric) }));
      const [found, missing] = [keyed.filter(({ key }) => key !== null), keyed.filter(({ key }) => key === null)];
      if (direction) found.sort((a, b) => (direction === "ascending" ? order(a.key, b.key) : order(b.key, a.key)));
      body.append(...(direction ? [...found, ...missing] : keyed).map(({ row }) => row));
    }
  }

  function press(head) {
    const direction = { null: "ascending", ascending: "descending", descending: null }[head.getAttribute("aria-sort")];
    for (const other of heads) other.removeAttribute("aria-sort");
    if (direction) head.setAttribute("aria-sort", direction);
    sort(columnOf(head), direction);
  }

  for (const head of heads) {
    if (!head.innerText.trim() && !head.textContent.trim()) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.setAttribute("aria-label", `Sort by ${head.textContent.replace(/\s+/g, " ").trim()}`);
    button.addEventListener("click", () => press(head));
    head.append(button);
  }
};

document.querySelectorAll("table.sortable").forEach(sorting);
