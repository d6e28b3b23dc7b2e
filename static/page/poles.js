// A pole of the pole map is dragged (widgets/target_model/pole_drag.py). The map is sent anew meanwhile: what counts is
// its frame as it was when the pole was taken.
let dragged = null;
const sendPole = ({ number, pole }, phase) => {
  const input = document.querySelector("div:has(> .vs-pole-field) + div input");
  if (!input || !pole) return;
  const text = `${number} ${pole[0]} ${pole[1]} ${phase} ${Math.random()}`;
  window.vsmrcEnter(input, text);
};
const at = (e) => {
  const { box, frame } = dragged;
  const x = ((e.clientX - box.left) / box.width) * 336 - frame.x, y = frame.y - ((e.clientY - box.top) / box.height) * 148;
  const r = Math.hypot(x, y), height = Math.max(y, 0);
  const fraction = (r - frame.hole) / (frame.outer - frame.hole);
  const size = 10 ** (frame.low + Math.max(fraction, -0.3) * (frame.high - frame.low));
  const angle = Math.atan2(height, x);
  return [size * Math.cos(angle), size * Math.sin(angle)];
};
document.addEventListener("pointerdown", (e) => {
  if (e.button !== 0) return;
  const mark = e.target instanceof Element && e.target.closest(".vs-poles [data-pole]");
  if (!mark || window.vsmrcWatches()) return;
  const svg = mark.closest("svg"), { x, y, hole, outer, low, high } = svg.dataset;
  dragged = { number: mark.dataset.pole, pointer: e.pointerId, box: svg.getBoundingClientRect(), pole: null,
    frame: { x: +x, y: +y, hole: +hole, outer: +outer, low: +low, high: +high } };
  e.preventDefault();
}, true);
document.addEventListener("pointermove", (e) => {
  if (e.pointerId !== dragged?.pointer) return;
  dragged.pole = at(e);
  sendPole(dragged, "held");
}, true);
document.addEventListener("pointerup", (e) => {
  if (e.pointerId !== dragged?.pointer) return;
  const last = dragged;
  dragged = null;
  setTimeout(() => sendPole(last, "dropped"), 80); // behind the last position, for which viser's slot has to be free
}, true);
const leavePole = () => {
  sendPole(dragged, "left");
  dragged = null;
};
document.addEventListener("pointercancel", (e) => { // the browser scrolls instead
  if (e.pointerId === dragged?.pointer) leavePole();
}, true);
document.addEventListener("keydown", (e) => {
  if (e.key !== "Escape" || !dragged) return;
  leavePole();
  e.preventDefault(); // one Esc ends one thing (stage.js)
}, true);
