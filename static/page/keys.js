// viser's hotkeys listen at the document's element and spare text fields only. Here, one step before, stand the other
// rules: a key belongs to the control that uses it, a held key acts once, and under the help none acts.
const closest = (e, selector) => e.target instanceof Element && e.target.closest(selector);
const press = (key) => document.documentElement.dispatchEvent(
  new KeyboardEvent("keydown", { key, code: key.length > 1 ? key : `Key${key.toUpperCase()}`, bubbles: true }));
const belongsToControl = (e) =>
  /^(Arrow|Home|End)/.test(e.key) ? closest(e, ".mantine-Slider-root, [role=slider], [role=separator], [role=tab]")
    : e.repeat || (/^( |Enter)$/.test(e.key) && closest(e, "button, a, summary, [role=button], [role=tab]"));
// A browser opens its dialog for a file only while a key or a button is being pressed, so not from the server.
const upload = () => {
  const way = document.querySelector("[data-upload]");
  if (way && !window.vsmrcWatches()) document.querySelector(`input[type=file][accept^="${way.dataset.upload}"]`)?.click();
  return way !== null;
};
// Commands are digits and Latin letters: where the keyboard has other ones there (a French one has digits with Shift
// only), the place of the key counts. "" where the key is itself.
const onLatinKeys = (e) => {
  const [, digit, letter] = /^(?:Digit([1-5])|Key([A-Z]))$/.exec(e.code) ?? [];
  if (!e.isTrusted || e.key.length !== 1 || e.getModifierState("AltGraph")) return "";
  if (digit) return e.shiftKey === (e.key === digit) ? digit : "";
  return letter && !e.shiftKey && /(?!\p{Script=Latin})\p{L}/u.test(e.key) ? letter.toLowerCase() : "";
};
document.body.addEventListener("keydown", (e) => {
  const help = document.querySelector(".vs-help");
  if (window.vsmrcTyping(e) || e.ctrlKey || e.metaKey || e.altKey) return;
  const latin = onLatinKeys(e);
  if (e.key === "?" || (help && e.key === "Escape")) { if (!e.repeat && !e.defaultPrevented) press("h"); }
  else if (latin && (!help || latin === "h")) {
    e.stopPropagation();
    const { code, repeat } = e; // as if that had been pressed
    document.body.dispatchEvent(new KeyboardEvent("keydown", { key: latin, code, repeat, bubbles: true, cancelable: true }));
  }
  else if (belongsToControl(e) || (help && !/^h$/i.test(e.key))) e.stopPropagation();
  else if (/^o$/i.test(e.key) && upload()) e.stopPropagation();
});
// what had the focus before the help gets it back: viser takes the help away without a word
let before = null;
document.addEventListener("focusin", (e) => {
  const within = closest(e, ".mantine-Modal-content");
  if (within && !within.contains(e.relatedTarget)) before = e.relatedTarget;
});
new MutationObserver(() => {
  if (!before || document.querySelector(".mantine-Modal-content")) return;
  if (document.activeElement === document.body) before.focus({ preventScroll: true });
  before = null;
}).observe(document.body, { subtree: true, childList: true });
document.addEventListener("click", (e) => {
  const tool = closest(e, "[data-key], [data-presents]"); // the presentation is begun by stage.js
  if (tool && closest(e, ".vs-help")) press("h");
  if (tool?.dataset.key) press(tool.dataset.key);
  else if (closest(e, "[data-upload]")) upload();
  else if (document.querySelector(".vs-help") && closest(e, ".mantine-Modal-inner") && !closest(e, ".mantine-Modal-content"))
    press("h");
  // What was pressed with a pointer does not keep the space key for itself: a button at once, because the next key may
  // come before the next picture; the others in a picture's time, because a menu gives its field the focus again.
  if (e.detail === 0) return;
  if (closest(e, "button, [role=tab]")) closest(e, "button, [role=tab]").blur();
  else if (closest(e, "[role=option], [role=checkbox], input[type=checkbox]"))
    requestAnimationFrame(() => document.activeElement?.blur());
}, true);
// a slider that was dragged, the timeline's too, leaves the arrow keys, Home and End to the steps through the run
document.addEventListener("mouseup", (e) => {
  const within = document.activeElement?.closest(".mantine-Slider-root");
  if (e.isTrusted && within) setTimeout(() => document.activeElement?.blur());
}, true);
// these step through the run: viser's camera, which listens at the document, would turn with them
document.documentElement.addEventListener("keydown", (e) => {
  if (e.key === "ArrowLeft" || e.key === "ArrowRight") e.stopPropagation();
});
