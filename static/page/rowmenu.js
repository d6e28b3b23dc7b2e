// Context menu of a number's row, by the right button, a long touch, or Shift+F10 and the menu key. The server gets
// the choice as a mark behind the row's text (app/dashboard/theme/style.py), as when a slider is let go.
const SWEPT = "\u2060", MOVED = "\u2061";
const menu = document.createElement("div");
Object.assign(menu, { className: "vs-menu", hidden: true });
menu.setAttribute("role", "menu");
for (const [mark, words, then] of [[SWEPT, "Sweep this: robustness map", "Across"], [MOVED, "Let a search move this", "Gain 1"]]) {
  const item = document.createElement("button");
  Object.assign(item, { type: "button", textContent: words });
  item.dataset.tab = "Robustness"; // which opens (palette.js)
  item.setAttribute("role", "menuitem");
  item.addEventListener("click", () => pick(mark, then));
  menu.append(item);
}
document.body.append(menu);
let row = null, back = null;
const close = () => { if (!menu.hidden) { menu.hidden = true; back?.focus(); row = back = null; } };
const open = (of, x, y) => {
  row = of;
  back = document.activeElement;
  menu.hidden = false;
  const { width, height } = menu.getBoundingClientRect();
  menu.style.left = `${Math.max(4, Math.min(x, innerWidth - width - 4))}px`;
  menu.style.top = `${Math.max(4, Math.min(y, innerHeight - height - 4))}px`;
  menu.firstChild.focus();
};
const pick = (mark, then) => {
  const input = row?.querySelector("input.mantine-TextInput-input");
  back = null;
  close();
  input?.dispatchEvent(new CustomEvent("vsmrc-mark", { bubbles: true, detail: mark })); // to rows.js
  focusWhenThere(then, performance.now() + 5000);
};
// the tab is drawn after it was opened; until then, and in a folder that is closed, nothing has the focus
const focusWhenThere = (label, until) => {
  const field = [...document.querySelectorAll("label")].find((each) => each.textContent === label && each.checkVisibility());
  const input = field && document.getElementById(field.htmlFor);
  if (input) focusClosed(input);
  else if (performance.now() < until && document.activeElement === document.body) setTimeout(focusWhenThere, 100, label, until);
};
// a menu that hears of the focus opens its list
const focusClosed = (input) => {
  const unheard = (e) => e.stopPropagation();
  window.addEventListener("focusin", unheard, true);
  input.focus();
  window.removeEventListener("focusin", unheard, true);
};
// a text field keeps the browser's own menu, with which one pastes
const rowOf = (target) => {
  const form = target instanceof Element && !target.closest("input") ? target.closest("form:not([data-held])") : null;
  if (form?.matches("div:has(> .vs-ticks) + form")) return null; // no sweep over the time
  const free = form?.querySelector(".mantine-TextInput-input:not(:disabled)") && !window.vsmrcWatches();
  return free && form.querySelector(".mantine-Slider-root")?.checkVisibility() ? form : null;
};
// iOS has no contextmenu for a long touch
const LONG = 600, STILL = 10; // ms, px
let touch = null; // { x, y, timer } of a finger that may stay
const lift = () => { clearTimeout(touch?.timer); touch = null; };
document.addEventListener("pointerdown", (e) => {
  lift();
  if (e.pointerType !== "touch" || !e.isPrimary || menu.contains(e.target)) return;
  const { target, clientX: x, clientY: y } = e;
  touch = { x, y, timer: setTimeout(() => {
    const of = rowOf(target); // not one whose slider is held
    if (of && menu.hidden) open(of, x, y);
  }, LONG) };
}, true);
document.addEventListener("pointermove", (e) => {
  if (touch && Math.hypot(e.clientX - touch.x, e.clientY - touch.y) > STILL) lift();
}, true);
for (const kind of ["pointerup", "pointercancel"]) document.addEventListener(kind, lift, true);
// the lift of the finger that opened the menu is no tap on what lies under it
let opening = false;
document.addEventListener("touchstart", () => { opening = menu.hidden; }, { capture: true, passive: true });
document.addEventListener("touchend", (e) => { if (opening && !menu.hidden) e.preventDefault(); }, { capture: true, passive: false });
document.addEventListener("contextmenu", (e) => {
  lift();
  if (menu.contains(e.target)) e.preventDefault(); // of the menu key, which has opened this one
  const of = rowOf(e.target);
  if (!of) return;
  e.preventDefault();
  e.stopPropagation();
  const box = of.getBoundingClientRect();
  open(of, e.clientX || box.left + 20, e.clientY || box.bottom);
}, true);
window.addEventListener("keydown", (e) => { // before other scripts: one Esc ends one thing
  if (!e.isTrusted) return; // other scripts press keys, too
  if (menu.hidden) {
    const of = (e.key === "ContextMenu" || (e.key === "F10" && e.shiftKey)) && rowOf(e.target);
    if (!of) return;
    const box = of.getBoundingClientRect();
    open(of, box.left + 20, box.bottom);
  } else {
    const items = [...menu.children], at = items.indexOf(document.activeElement);
    if (e.key === "Escape" || e.key === "Tab") close();
    else if (e.key === "ArrowDown" || e.key === "ArrowUp")
      items[(at + (e.key === "ArrowDown" ? 1 : items.length - 1)) % items.length].focus();
    else if (e.key === "Enter" || e.key === " ") items[at]?.click();
    else if (e.ctrlKey || e.metaKey || e.altKey) return; // no other key commands the run behind the menu
  }
  e.preventDefault();
  e.stopPropagation();
}, true);
document.addEventListener("pointerdown", (e) => { if (!menu.contains(e.target)) { back = null; close(); } }, true);
// the right button moves no slider
window.addEventListener("mousedown", (e) => { if (e.button === 2 && rowOf(e.target)) e.stopPropagation(); }, true);
