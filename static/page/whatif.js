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
const moveTo = (x, y, { left, top, width, height }) => {
  moved.x = keep(x, -left, innerWidth - left - width);
  moved.y = keep(y, -top, innerHeight - top - height);
  for (const side of ["x", "y"]) document.documentElement.style.setProperty(`--vs-moved-${side}`, `${moved[side]}px`);
};
document.addEventListener("pointermove", (e) => {
  if (!from) return;
  e.stopPropagation();
  moveTo(e.clientX - from.x, e.clientY - from.y, from);
}, true);
// the page may have become smaller since the window was dragged
setInterval(() => {
  const box = (moved.x || moved.y) && !from && !document.documentElement.matches("[data-stage]")
    && document.querySelector("[data-floating-window]:has(.vs-held)");
  if (!box) return;
  const { left, top, width, height } = box.getBoundingClientRect();
  if (left < 0 || top < 0 || left + width > innerWidth || top + height > innerHeight)
    moveTo(moved.x, moved.y, { left: left - moved.x, top: top - moved.y, width, height });
}, 300);
for (const kind of ["pointerup", "pointercancel"]) document.addEventListener(kind, () => { from = null; }, true);
