// What all pages share: the address as a store of states, the skip link, and unfolding for a link.
//
// After "#" an address holds, joined by "&", at most one anchor (an id; it has no "=") and states of scripts (key=value):
//   #rmse-0             an anchor
//   #hide=3,5           a state
//   #rmse-0&hide=3,5    both
// Scripts of pages read and write their own keys and leave the rest as it is:
//   address.anchor()                 "rmse-0", or ""
//   address.get("hide")              "3,5", or null where the address does not say
//   address.set({ hide: "3,5" })     null or "" takes a key out; the history gets no new entry
//   address.push({ show: "nees" })   the same as a new entry, which the button "back" undoes
//   address.follow(show)             calls show() now, and whenever the address changes but by set and push
// A link to an anchor alone keeps the states.
"use strict";

const address = (() => {
  const followers = [];
  let known = null; // the part behind "#" that the page shows
  let current = { anchor: "", states: new Map() };

  function decoded(text) {
    try {
      return decodeURIComponent(text);
    } catch {
      return text;
    }
  }

  function read() {
    const items = location.hash.slice(1).split("&").filter(Boolean);
    const states = items.filter((item) => item.includes("=")).map((item) => {
      const at = item.indexOf("=");
      return [decoded(item.slice(0, at)), decoded(item.slice(at + 1))];
    });
    return { anchor: items.find((item) => !item.includes("=")) ?? "", states: new Map(states) };
  }

  // Commas and colons may stand in an address as they are, and are easier to read so.
  const encoded = (text) => encodeURIComponent(text).replaceAll("%2C", ",").replaceAll("%3A", ":");

  function written(anchor, states) {
    return [anchor, ...[...states].map(([key, value]) => `${encoded(key)}=${encoded(value)}`)].filter(Boolean).join("&");
  }

  function change(changes, method) {
    for (const [key, value] of Object.entries(changes)) {
      if (value === null || value === "") current.states.delete(key);
      else current.states.set(key, String(value));
    }
    put(method);
  }

  // An entry of the history that was written here is marked; one that a link made is not.
  function put(method) {
    const after = written(current.anchor, current.states);
    history[method]({ written: true }, "", after ? `#${after}` : location.pathname + location.search);
    known = location.hash;
  }

  function arrive() {
    if (location.hash === known) return;
    const found = read();
    const linked = found.anchor && !found.states.size && !history.state;
    current = linked ? { anchor: found.anchor, states: current.states } : found;
    visit();
    for (const show of followers) show();
    unfold();
  }

  // The browser finds a target for an anchor alone, so an anchor beside states is visited by itself first.
  function visit() {
    if (current.anchor && current.states.size) location.replace(`#${current.anchor}`);
    put("replaceState");
  }

  // What is folded away is unfolded for a link; newer browsers do so by themselves.
  function unfold() {
    const target = document.getElementById(decoded(current.anchor));
    const folded = target?.closest("details:not([open])");
    if (!folded) return;
    for (let each = folded; each; each = each.parentElement.closest("details")) each.open = true;
    target.scrollIntoView();
  }

  arrive();
  window.addEventListener("hashchange", arrive);
  window.addEventListener("load", visit); // when a page is whole the browser looks for the target once more
  return {
    anchor: () => decoded(current.anchor),
    get: (key) => current.states.get(key) ?? null,
    set: (changes) => change(changes, "replaceState"),
    push: (changes) => change(changes, "pushState"),
    follow: (show) => {
      followers.push(show);
      show();
    },
  };
})();

// The skip link moves the focus but leaves the address, which holds the choice.
function skipLink() {
  document.querySelector(".skip").addEventListener("click", (event) => {
    event.preventDefault();
    document.getElementById("page_main").focus();
  });
}

skipLink();
