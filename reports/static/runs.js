// The choice of the run whose tracks are shown. The address says run=<id of the figure>. Without scripts all are shown.
"use strict";

const choiceOfRun = () => {
  const buttons = [...document.querySelectorAll(".choose-run input")];
  if (!buttons.length) return;
  const ids = buttons.map((button) => button.value);
  const usual = ids.find((id) => id.endsWith("-median")) ?? ids[0];

  function show() {
    const wanted = [address.get("run"), address.anchor(), usual].find((id) => ids.includes(id));
    for (const button of buttons) {
      button.checked = button.value === wanted;
      document.getElementById(button.value).hidden = button.value !== wanted;
    }
  }

  for (const button of buttons) {
    button.addEventListener("change", () => {
      address.set({ run: button.value });
      show();
    });
  }
  document.querySelector(".choose-run").hidden = false;
  address.follow(show);
};

choiceOfRun();
