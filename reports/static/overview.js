// The overview: what the matrix shows, in which colours and which order, and what a cell says when it is pointed at.
"use strict";

const overview = (() => {
  const table = document.querySelector(".matrix");
  const form = document.getElementById("controls");
  if (!table) return { receive() {} };

  const FIELDS = ["state", "value", "unit", "interval", "mark", "runs", "shade", "bound", "note", "number", "ratio", "over", "place"];
  const { choices, texts, said } = JSON.parse(document.getElementById("matrix-data").textContent);
  const received = new Map(); // by choice, its rows of cells
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells].slice(1).map((th, number) => ({ th, number, name: th.textContent.trim(), key: th.dataset.key }));
  const rows = [...body.rows].map((tr, number) => {
    const [th, ...cells] = tr.cells;
    return { tr, th, cells, number, name: th.querySelector("a").textContent };
  });
  const controls = [...form.elements].filter((element) => element.name);
  const state = {};
  let choice = choices[0];
  let drawn = `${choice.id} shade`; // the choice and colours that the cells show
  let missing = null; // the choice whose file is not there

  // What a choice gives of a cell by the names of its fields; nothing where the cell does not depend on choices.
  function named(list, notes) {
    if (!list) return null;
    const cell = Object.fromEntries(FIELDS.map((field, i) => [field, list[i] ?? null]));
    cell.note = notes[cell.note ?? 0];
    return cell;
  }

  function receive(id, { notes, rows: found }) {
    received.set(id, found.map((row) => ({ ...row, cells: row.cells.map((cell) => named(cell, notes)) })));
    if (id === choice.id) render();
  }

  // Pages on a disk cannot fetch, but they can add a script.
  function load(id) {
    if (document.getElementById(`data-${id}`)) return;
    const script = document.createElement("script");
    script.id = `data-${id}`;
    script.src = `data/matrix-${id}.js`;
    script.onerror = () => {
      missing = id;
      render();
    };
    document.head.append(script);
  }

  const shownOf = (row, head) => received.get(choice.id)?.[row.number].cells[head.number] ?? null;

  // ---- Cells.

  function span(name, text) {
    const element = document.createElement("span");
    element.className = name;
    element.textContent = text;
    return element;
  }

  function fill(td, cell, shade) {
    const link = td.firstElementChild;
    const tags = link.querySelectorAll(".tag");
    const parts = ["mark", "interval", "runs"].filter((part) => cell[part]).map((part) => span(part, cell[part]));
    const value = span("value", [cell.value, cell.unit].filter(Boolean).join(" "));
    link.replaceChildren(...[value, ...parts, ...tags].flatMap((part) => [part, " "]));
    td.className = `cell ${cell.state.replaceAll(" ", "-")}${cell[shade] >= 0 ? ` shade-${cell[shade]}` : ""}`;
  }

  function fillAll(shade) {
    const found = received.get(choice.id);
    for (const row of rows) {
      const { block, unit, cells } = found[row.number];
      row.th.querySelector("[data-under]").textContent = unit ? `${block} (${unit})` : block;
      row.cells.forEach((td, c) => cells[c] && fill(td, cells[c], shade));
    }
  }

  function explain(shade) {
    document.querySelector("[data-title]").textContent = choice.title;
    document.querySelector("[data-block]").textContent = choice.block;
    document.querySelector("[data-better]").textContent = choice.better;
    document.querySelector("[data-legends]").hidden = !choice.legend.length;
    document.querySelector("[data-needs-bound]").hidden = shade !== "bound";
    for (const list of document.querySelectorAll("[data-legend]")) {
      const words = choice[list.dataset.legend];
      list.hidden = list.dataset.legend !== (shade === "bound" ? "bound" : "legend") || !words.length;
      [...list.children].forEach((item, i) => { item.lastElementChild.textContent = words[i] ?? ""; });
    }
  }

  // ---- Order and filters.

  const holds = (text, wanted) => text.toLowerCase().includes(wanted.trim().toLowerCase());
  const hasNumber = (row, head) => shownOf(row, head)?.number != null;
  const byName = (a, b) => a.name.localeCompare(b.name, "en", { numeric: true });

  function wantedRows() {
    return rows.filter(({ tr, th }) => (!state.scenario || tr.dataset.scenario === state.scenario)
      && (!state.truth || tr.dataset.truth === state.truth) && holds(th.textContent, state.case));
  }

  function wantedHeads() {
    return heads.filter(({ th, name }) => (!state.kind || th.dataset.kinds.split(" ").includes(state.kind)) && holds(name, state.estimator));
  }

  // Rows by what an estimator has in them, those in which it has nothing at the end.
  function inOrder(shown) {
    const sign = state.down ? -1 : 1;
    if (state.order === "name") return shown.sort((a, b) => sign * byName(a, b));
    const head = heads.find(({ key }) => key === state.by);
    if (!head || !["ratio", "value"].includes(state.order)) return shown;
    const field = state.order === "ratio" ? "ratio" : "number";
    const of = new Map(shown.map((row) => [row, shownOf(row, head)?.[field] ?? null]));
    return shown.sort((a, b) => (of.get(a) === null) - (of.get(b) === null) || sign * (of.get(a) - of.get(b)) || a.number - b.number);
  }

  function columnsInOrder(shown, over) {
    if (state.columns === "name") return shown.sort(byName);
    if (!state.columns) return shown;
    const marks = new Map(shown.map((head) => [head, over.filter((row) => shownOf(row, head)?.mark).length]));
    const mean = new Map(shown.map((head) => {
      const places = over.map((row) => shownOf(row, head)?.place).filter(Boolean);
      return [head, places.length ? places.reduce((a, b) => a + b) / places.length : 1e9];
    }));
    const byMean = (a, b) => mean.get(a) - mean.get(b) || a.number - b.number;
    return shown.sort(state.columns === "marks" ? (a, b) => marks.get(b) - marks.get(a) || byMean(a, b) : byMean);
  }

  function arrange() {
    let [some, columns] = [wantedRows(), wantedHeads()];
    if (state.empty && received.has(choice.id)) {
      columns = columns.filter((head) => some.some((row) => hasNumber(row, head)));
      some = some.filter((row) => columns.some((head) => hasNumber(row, head)));
    }
    some = inOrder(some);
    columns = columnsInOrder(columns, some);
    const order = [...columns, ...heads.filter((head) => !columns.includes(head))];
    const visible = new Set(columns);
    place(table.tHead.rows[0], order.map((head) => head.th));
    for (const { th } of heads) th.hidden = true;
    for (const { th } of columns) th.hidden = false;
    for (const row of rows) {
      place(row.tr, order.map((head) => row.cells[head.number]));
      for (const head of heads) row.cells[head.number].hidden = !visible.has(head);
      row.tr.hidden = true;
    }
    for (const row of some) row.tr.hidden = false;
    place(body, [...some, ...rows.filter((row) => !some.includes(row))].map((row) => row.tr), 0);
    const none = !some.length || !columns.length;
    document.querySelector(".matrix-box").hidden = none;
    document.querySelector("[data-none]").hidden = !none;
    return [some.length, columns.length];
  }

  // Puts children in order behind so many that stay, and leaves all alone where they are in order.
  function place(parent, children, after = 1) {
    if (children.some((child, i) => parent.children[i + after] !== child)) parent.append(...children);
  }

  // ---- The state: controls, address, words.

  // The controls show the state; what the address says and no control offers counts as nothing.
  function read() {
    for (const control of controls) {
      if (control.name === "block") continue;
      set(control, address.get(control.name) ?? "");
      state[control.name] = valueOf(control);
    }
    const metric = state.show || choices[0].metric;
    const offered = choices.filter((each) => each.metric === metric);
    const select = form.elements.block;
    select.replaceChildren(...offered.map((each, i) => new Option(each.block, i ? each.block : "")));
    select.disabled = offered.length < 2;
    set(select, address.get("block") ?? "");
    state.block = select.value;
    choice = offered[select.selectedIndex];
    const sorted = ["ratio", "value"].includes(state.order);
    if (sorted && !state.by) state.by = form.elements.by.value = heads[0].key;
    form.querySelector("[data-sorted]").hidden = !sorted;
    form.querySelector("[data-ordered]").hidden = !state.order;
    form.elements.colour.options[1].disabled = !choice.bound.length;
  }

  function set(control, value) {
    if (control.type === "checkbox") control.checked = value === control.value;
    else control.value = value;
    if (control.selectedIndex === -1) control.selectedIndex = 0;
  }

  const valueOf = (control) => (control.type === "checkbox" ? (control.checked ? control.value : "") : control.value);

  function render() {
    const compact = state.detail ? state.detail === "compact" : form.elements.detail.options[1].value === "full";
    table.classList.toggle("compact", compact);
    document.querySelector(".short").hidden = !compact;
    const shade = state.colour === "bound" && choice.bound.length ? "bound" : "shade";
    const wanted = `${choice.id} ${shade}`;
    if (!received.has(choice.id)) load(choice.id);
    else if (drawn !== wanted) {
      fillAll(shade);
      explain(shade);
      drawn = wanted;
    }
    const [cases, estimators] = arrange();
    for (const { th, key } of heads) {
      const sorted = key === state.by && ["ratio", "value"].includes(state.order);
      if (sorted) th.setAttribute("aria-sort", state.down ? "descending" : "ascending");
      else th.removeAttribute("aria-sort");
    }
    const lost = missing === choice.id ? ` The numbers of this choice are missing: data/matrix-${missing}.js is not beside this page.` : "";
    document.querySelector("[data-status]").textContent = `${cases} of ${rows.length} cases, ${estimators} of ${heads.length} estimators.${lost}`;
    rove();
  }

  function follow() {
    read();
    render();
  }

  const current = () => Object.fromEntries(controls.map((control) => [control.name, valueOf(control)]));

  function change(changes, method) {
    const before = (key) => address.get(key) ?? "";
    if (Object.keys(changes).every((key) => before(key) === changes[key])) return;
    address[method](changes);
    follow();
  }

  // The first click on an estimator's button sorts the cases by it, the second the other way, the third not.
  function sortBy(key) {
    const order = choice.legend.length && choice.factor ? "ratio" : "value";
    const mine = state.by === key && ["ratio", "value"].includes(state.order);
    if (!mine) change({ order, by: key, down: "" }, "push");
    else if (!state.down) change({ down: "down" }, "push");
    else change({ order: "", by: "", down: "" }, "push");
  }

  // ---- What a cell says when it is pointed at, in lines.

  function words(row, head) {
    const cell = shownOf(row, head);
    const lines = [`${head.name} on ${row.name}`];
    if (cell && cell.number !== null) {
      const { block, unit } = received.get(choice.id)[row.number];
      const value = [cell.value, cell.unit || unit].filter(Boolean).join(" ");
      const plain = /^[^a-z]+( to |$)/.test(cell.interval) ? `95 % interval ${cell.interval}` : cell.interval;
      if (cell.state !== "negligible") lines.push(`${choice.title}, ${block}: ${value}${cell.interval ? ` (${plain})` : ""}`);
      const held = [];
      if (cell.ratio !== null && cell.ratio !== 1) held.push(`${short(cell.ratio)} ${choice.factor}`);
      if (cell.over !== null && cell.over !== cell.number) held.push(`${short(cell.over)} times the bound`);
      if (held.length) lines.push(held.join("; "));
      if (cell.mark) lines.push(cell.mark === "best" ? "best: every other that competes is worse beyond chance" : "tie: among the best");
    } else lines[0] += `: ${cell ? cell.value : row.cells[head.number].textContent.trim()}`;
    if (cell?.runs) lines.push(cell.runs);
    if (cell?.note) lines.push(cell.note);
    return [...lines, ...said[row.number][head.number].map((i) => texts[i])];
  }

  // Ratios have no interval of their own: two digits, no more.
  const short = (x) => (x === Infinity ? "infinitely many" : `about ${x < 10 ? x.toPrecision(2) : Number(x.toPrecision(2))}`);

  tooltip(table, (link) => {
    const td = link.closest("td");
    if (!td) return [];
    const row = rows.find(({ tr }) => tr === td.parentElement);
    return words(row, heads.find(({ number }) => row.cells[number] === td));
  });
  const rove = arrows(table);

  for (const head of heads) {
    const button = Object.assign(document.createElement("button"), { type: "button", className: "sort" });
    button.setAttribute("aria-label", `Sort cases by ${head.name}`);
    button.addEventListener("click", () => sortBy(head.key));
    head.th.append(button);
  }
  form.addEventListener("change", (event) => event.target.name === "show" ? change({ ...current(), block: "" }, "push") : change(current(), "push"));
  form.addEventListener("input", (event) => event.target.type === "search" && change(current(), "set"));
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", (event) => {
    event.preventDefault();
    change(Object.fromEntries(controls.map(({ name }) => [name, ""])), "push");
  });
  form.hidden = false;
  queueMicrotask(() => address.follow(follow)); // after this function has returned, since data hand themselves to `overview`
  return { receive };
})();
