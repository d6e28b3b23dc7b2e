// The window of what-if stands where the scene has room (page.css), and viser's own dragging would not know that place. It
// is dragged by its grip: moved by so much from where it stands, until the page is loaded again. A preview stands elsewhere
// than what was applied, and is moved for itself; in the presentation neither is.
const moved = { preview: { x: 0, y: 0 }, applied: { x: 0, y: 0 } };
let from = null;
const windowOf = (target) => (target instanceof Element ? target.closest("[data-floating-window]:has(.vs-held)") : null);
const shownIn = (box) => (box.matches(":has(.vs-preview)") ? "preview" : "applied");
const onStage = () => document.documentElement.matches("[data-stage]");
const keep = (value, least, most) => Math.min(Math.max(value, least), Math.max(least, most));
// where it would stand if it had not been moved
const placeOf = (box) => {
  const shown = shownIn(box), { left, top, width, height } = box.getBoundingClientRect();
  return { shown, left: left - moved[shown].x, top: top - moved[shown].y, width, height };
};
const moveTo = (x, y, { shown, left, top, width, height }) => {
  moved[shown] = { x: keep(x, -left, innerWidth - left - width), y: keep(y, -top, innerHeight - top - height) };
  for (const side of ["x", "y"])
    document.documentElement.style.setProperty(`--vs-${shown}-${side}`, `${moved[shown][side]}px`);
};
document.addEventListener("pointerdown", (e) => {
  const box = windowOf(e.target), grip = box && e.target.closest("[data-dock-griphandle]");
  if (!grip || e.button !== 0) return;
  e.stopPropagation();
  if (onStage()) return;
  const place = placeOf(box), { x, y } = moved[place.shown];
  from = { x: e.clientX - x, y: e.clientY - y, place };
  grip.setPointerCapture(e.pointerId);
}, true);
document.addEventListener("pointermove", (e) => {
  if (!from) return;
  e.stopPropagation();
  moveTo(e.clientX - from.x, e.clientY - from.y, from.place);
}, true);
// the page may have become smaller since the window was dragged
setInterval(() => {
  const box = !from && !onStage() && document.querySelector("[data-floating-window]:has(.vs-held)");
  if (!box) return;
  const place = placeOf(box), { x, y } = moved[place.shown], left = place.left + x, top = place.top + y;
  if (!x && !y) return;
  if (left < 0 || top < 0 || left + place.width > innerWidth || top + place.height > innerHeight) moveTo(x, y, place);
}, 300);
for (const kind of ["pointerup", "pointercancel"]) document.addEventListener(kind, () => { from = null; }, true);
