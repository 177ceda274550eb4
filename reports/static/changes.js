// Which changes are shown: all, or those with one verdict. The address says verdict=<word>, nothing for all.
"use strict";

const changes = () => {
  const choices = [...document.querySelectorAll("input[name=verdict]")];
  const rows = [...document.querySelectorAll("[data-verdict]")];
  const cases = [...document.querySelectorAll("[data-case]")];
  const nothing = document.querySelector("[data-nothing]");
  if (!choices.length) return;

  function show() {
    const wanted = address.get("verdict") ?? "";
    const choice = choices.find((each) => each.value === wanted) ?? choices[0];
    choice.checked = true;
    for (const row of rows) row.hidden = choice.value !== "" && row.dataset.verdict !== choice.value;
    for (const each of cases) each.hidden = choice.value !== "" && !each.querySelector("[data-verdict]:not([hidden])");
    nothing.hidden = cases.some((each) => !each.hidden);
  }

  for (const choice of choices) {
    choice.addEventListener("change", () => {
      address.push({ verdict: choice.value });
      show();
    });
  }
  document.querySelector("fieldset.choices").hidden = false;
  address.follow(show);
};

changes();
