// Tiles of the robustness map, and candidates of a search. The numbers of one are shown at the mouse, with the focus of the
// keyboard and at the first touch; a click, Enter or the second touch chooses one, whose number is written into the
// hidden field of its picture. The picture is sent again and again: the tile that was looked at stays described.
const TILE = ".vs-tiles [data-point]";
const tileOf = (target) => (target instanceof Element ? target.closest(TILE) : null);
const fieldOf = (tile) => tile.closest(".vs-tiles").dataset.field;
const tileAt = ({ field, point }) => document.querySelector(`.vs-tiles[data-field="${field}"] [data-point="${point}"]`);
const placeOf = (tile) => (tile ? { field: fieldOf(tile), point: tile.dataset.point } : null);
let described = null, focused = null; // { field, point }
const choose = (tile) => writeTo(fieldOf(tile), tile.dataset.point);
const writeTo = (field, text) => {
  const input = document.querySelector(`div:has(> .${field}) + div input`);
  if (!input || window.vsmrcWatches()) return;
  window.vsmrcEnter(input, `${text} ${Math.random()}`);
};
const describe = () => {
  for (const line of document.querySelectorAll(".vs-description")) {
    const tile = described?.field === line.dataset.of && tileAt(described), text = tile ? tile.getAttribute("aria-label") : "";
    if (line.textContent !== text) line.textContent = text;
    for (const marked of document.querySelectorAll(`.vs-tiles[data-field="${line.dataset.of}"] [data-described]`))
      if (marked !== tile) delete marked.dataset.described;
    if (tile) tile.dataset.described = "";
  }
};
const lookAt = (tile) => { described = placeOf(tile) ?? described; describe(); };
document.addEventListener("pointerover", (e) => { if (e.pointerType === "mouse" && tileOf(e.target)) lookAt(tileOf(e.target)); }, true);
// at once: the next key may come before any timer
const focusKeeper = new MutationObserver(() => {
  if (focused && document.activeElement === document.body) tileAt(focused)?.focus({ preventScroll: true });
});
document.addEventListener("focusin", (e) => {
  focused = placeOf(tileOf(e.target));
  focusKeeper.disconnect();
  if (!focused) return;
  lookAt(tileOf(e.target));
  focusKeeper.observe(document.body, { childList: true, subtree: true });
}, true);
// what was chosen with a pointer does not keep the space key for itself (keys.js)
let pointed = false, tapped = null; // tapped: { field, point, id } of a second touch, which may still become a scroll
document.addEventListener("pointercancel", (e) => {
  pointed = false;
  if (tapped?.id === e.pointerId) tapped = null;
}, true);
document.addEventListener("pointerup", (e) => {
  if (tapped?.id === e.pointerId) {
    const { field, point } = tapped, over = placeOf(tileOf(document.elementFromPoint(e.clientX, e.clientY)));
    if (over?.field === field && over.point === point) writeTo(field, point);
    tapped = null;
  }
  if (!pointed) return;
  pointed = false;
  focused = null;
  document.activeElement?.blur();
}, true);
document.addEventListener("pointerdown", (e) => { // a click may lose its tile, which is drawn anew
  const tile = tileOf(e.target);
  if (!tile) { focused = null; return; }
  pointed = true;
  if (e.button !== 0) return;
  const again = described && described.field === fieldOf(tile) && described.point === tile.dataset.point;
  if (e.pointerType === "mouse") choose(tile);
  else if (again) tapped = { ...placeOf(tile), id: e.pointerId };
  lookAt(tile);
}, true);
document.addEventListener("keydown", (e) => {
  const tile = tileOf(e.target);
  const ends = e.key === "Escape" && !e.defaultPrevented && !window.vsmrcWatches();
  const previewed = ends && document.querySelector(".vs-tiles[data-previewed]");
  if (previewed) {
    writeTo(previewed.dataset.field, "left");
    e.preventDefault(); // one Esc ends one thing (stage.js)
  }
  if (!tile) return;
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
  if (step) {
    const all = [...tile.closest(".vs-tiles").querySelectorAll("[data-point]")], [i, j] = tile.dataset.at.split(",").map(Number);
    const place = (other) => other.dataset.at.split(",").map(Number);
    const ahead = (other) => { const [a, b] = place(other); return (a - i) * step[0] + (b - j) * step[1]; };
    const aside = (other) => { const [a, b] = place(other); return Math.abs((a - i) * step[1]) + Math.abs((b - j) * step[0]); };
    // the nearest one that way: tiles may be missing still, and candidates lie anywhere
    all.filter((other) => ahead(other) > 0).sort((a, b) => ahead(a) + 3 * aside(a) - ahead(b) - 3 * aside(b))[0]?.focus();
  } else if (e.key === "Enter" || e.key === " ") choose(tile);
  else return;
  e.preventDefault();
  e.stopPropagation();
}, true);
// A picture that the user has asked for comes into view when its first marks come, and stays there while the words above
// it grow, unless the user does something else meanwhile.
const BEGUN = 300_000, GROWING = 10_000; // ms; a busy machine takes long to begin
const FIELDS = ["vs-tile-field", "vs-candidate-field"];
const pictureOf = (field) => document.querySelector(`.vs-tiles[data-field="${field}"]`);
let awaited = null; // { field, first, until }
document.addEventListener("click", (e) => {
  const button = e.target instanceof Element && e.target.closest("button");
  const inItsPanel = (field) => document.querySelector(`.${field}`)?.closest(".mantine-Paper-root")?.contains(button);
  const field = button && FIELDS.find(inItsPanel);
  const old = field && pictureOf(field);
  if (field && !old?.matches("[data-going]")) awaited = { field, first: !old, until: performance.now() + BEGUN }; // else it cancels
}, true);
for (const kind of ["wheel", "touchmove", "pointerdown", "keydown"])
  document.addEventListener(kind, () => { awaited = null; }, { capture: true, passive: true });
const comeIntoView = () => {
  const picture = pictureOf(awaited.field);
  if (picture && (awaited.first || picture.matches("[data-going]"))) { // the first may be done before it is looked at
    awaited = { field: awaited.field, first: false, until: performance.now() + GROWING };
    picture.closest(".vs-checks").scrollIntoView({ block: "nearest" });
  }
  if (performance.now() > awaited.until) awaited = null;
};
setInterval(() => {
  if (described) describe();
  if (awaited) comeIntoView();
}, 150);
