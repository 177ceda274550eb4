// The table of paired differences: the reader chooses the reference and the block of the state.
//
// The address says against=<name of the estimator> and of=<block>, where they are not the first ones. The rows of all
// references are in a script of their own, which is loaded when another one is chosen and hands them over as an event.
"use strict";

const differences = (table) => {
  const section = document.getElementById("differences-section");
  const choices = { against: document.getElementById("differences-against"), of: document.getElementById("differences-of") };
  const keys = Object.keys(choices);
  const first = Object.fromEntries(keys.map((key) => [key, choices[key].value]));
  const rows = [...table.tBodies[0].rows].sort((a, b) => a.dataset.row - b.dataset.row);
  let data = null;
  let asked = false;

  const chosen = (select) => select.selectedOptions[0].textContent;

  function fill(row, isReference, words, sorts, kind) {
    [...row.cells].slice(1).forEach((cell, i) => {
      cell.textContent = words[i];
      if (i < sorts.length) cell.dataset.sort = sorts[i];
    });
    row.className = isReference ? "reference" : kind;
  }

  function show() {
    const against = choices.against.selectedIndex;
    const found = new Map(data.rows[against][choices.of.selectedIndex].map(([place, ...row]) => [place, row]));
    rows.forEach((row, place) => {
      const [words, sorts, kind] = found.get(place) ?? [["", "", "", "", "", "no common run"], ["", "", "", "", ""], ""];
      fill(row, place === against, place === against ? [...words.slice(0, 5), "the reference"] : words, sorts, kind);
    });
    for (const name of section.querySelectorAll("[data-reference]")) name.textContent = chosen(choices.against);
    for (const name of section.querySelectorAll("[data-of]")) name.textContent = chosen(choices.of);
  }

  function load() {
    if (data) show();
    if (asked) return;
    asked = true;
    window.addEventListener("differences", (event) => { data = event.detail; show(); }, { once: true });
    const script = document.createElement("script");
    script.src = table.dataset.rows;
    script.addEventListener("error", () => { document.getElementById("differences-missing").hidden = false; });
    document.head.append(script);
  }

  // What the address does not say, or says wrongly, is as at first.
  function fromAddress() {
    for (const key of keys) {
      const wanted = address.get(key);
      choices[key].value = [...choices[key].options].some((option) => option.value === wanted) ? wanted : first[key];
    }
    if (data || keys.some((key) => choices[key].value !== first[key])) load();
  }

  for (const key of keys) {
    choices[key].addEventListener("change", () => {
      address.set({ [key]: choices[key].value === first[key] ? null : choices[key].value });
      load();
    });
  }
  document.getElementById("differences-choice").hidden = false;
  address.follow(fromAddress);
};

document.querySelectorAll("#differences-table").forEach(differences);
