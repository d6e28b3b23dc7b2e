// The window of what a held slider would do stands where the scene has room (page.css), and viser's own dragging would not
// know that place. It is dragged by its grip: moved by so much from where it stands, until the page is loaded again.
const moved = { x: 0, y: 0 };
let from = null;
const windowOf = (target) => (target instanceof Element ? target.closest("[data-floating-window]:has(.vs-held)") : null);
const keep = (value, least, most) => Math.min(Math.max(value, least), Math.max(least, most));
document.addEventListener("pointerdown", (e) => {
  const box = windowOf(e.target), grip = box && e.target.closest("[data-dock-griphandle]");
  if (!grip || e.button !== 0) return;
  e.stopPropagation();
  const { left, top, width, height } = box.getBoundingClientRect();
  from = { x: e.clientX - moved.x, y: e.clientY - moved.y, left: left - moved.x, top: top - moved.y, width, height };
  grip.setPointerCapture(e.pointerId);
}, true);
document.addEventListener("pointermove", (e) => {
  if (!from) return;
  e.stopPropagation();
  moved.x = keep(e.clientX - from.x, -from.left, innerWidth - from.left - from.width);
  moved.y = keep(e.clientY - from.y, -from.top, innerHeight - from.top - from.height);
  for (const side of ["x", "y"]) document.documentElement.style.setProperty(`--vs-moved-${side}`, `${moved[side]}px`);
}, true);
for (const kind of ["pointerup", "pointercancel"]) document.addEventListener(kind, () => { from = null; }, true);
