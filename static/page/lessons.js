// Pads on which a course is drawn (widgets/lesson/outcome_chart.py): by mouse or finger, or with the arrow keys.
// What is drawn is written into the hidden text field behind the pad.
const COUNT = 25;
const OPEN = ".vs-pad:not([data-locked='1']) svg";
const padOf = (e) => {
  const svg = e.target instanceof Element && e.target.closest(OPEN);
  if (window.vsmrcWatches()) return null;
  if (svg && !svg.vsmrcDrawn) svg.vsmrcDrawn = { values: Array(COUNT).fill(null), at: 0 };
  return svg;
};
const number = (svg, name) => Number(svg.dataset[name]);
const xAt = (svg, k) => number(svg, "left") + ((number(svg, "right") - number(svg, "left")) * k) / (COUNT - 1);
const yAt = (svg, value) => number(svg, "bottom")
  - ((number(svg, "bottom") - number(svg, "top")) * (value - number(svg, "low"))) / (number(svg, "high") - number(svg, "low"));
// the values at all places: between two that were drawn on a line, beyond the last as it
const course = (values) => {
  const known = values.map((value, k) => [k, value]).filter(([, value]) => value !== null);
  if (!known.length) return [];
  return values.map((value, k) => {
    if (value !== null) return value;
    const before = known.findLast(([j]) => j < k), after = known.find(([j]) => j > k);
    if (!before || !after) return (before ?? after)[1];
    return before[1] + ((after[1] - before[1]) * (k - before[0])) / (after[0] - before[0]);
  });
};
const show = (svg) => {
  const { values, at } = svg.vsmrcDrawn, drawn = course(values);
  const path = drawn.map((value, k) => `${k ? "L" : "M"} ${xAt(svg, k).toFixed(1)} ${yAt(svg, value).toFixed(1)}`);
  svg.querySelector(".vs-drawn").setAttribute("d", path.join(" "));
  const pen = svg.querySelector(".vs-pen");
  pen.setAttribute("cx", xAt(svg, at));
  pen.setAttribute("cy", yAt(svg, drawn[at] ?? (number(svg, "low") + number(svg, "high")) / 2));
  pen.setAttribute("visibility", document.activeElement === svg ? "visible" : "hidden");
};
const textOf = (svg) => svg.closest("div:has(> .vs-pad)")?.nextElementSibling?.querySelector("input");
const send = (svg) => {
  const input = textOf(svg);
  if (!input) return;
  const from = number(svg, "from"), to = number(svg, "to");
  const points = course(svg.vsmrcDrawn.values).map((value, k) => [from + ((to - from) * k) / (COUNT - 1), value]);
  svg.vsmrcSent = JSON.stringify(points);
  window.vsmrcEnter(input, svg.vsmrcSent);
};
// what was drawn before the page was loaded again, or on another page, is what would be locked
setInterval(() => {
  for (const svg of document.querySelectorAll(OPEN)) {
    const text = textOf(svg)?.value;
    if (text === undefined || svg === drawing || text === (svg.vsmrcSent ?? "")) continue;
    svg.vsmrcSent = text;
    if (!text) { // the server has other axes
      svg.vsmrcDrawn = { values: Array(COUNT).fill(null), at: 0 };
      show(svg);
      continue;
    }
    try {
      const values = JSON.parse(text).map(([, value]) => value);
      if (values.length !== COUNT) continue;
      svg.vsmrcDrawn = { values, at: svg.vsmrcDrawn?.at ?? 0 };
      show(svg);
    } catch { /* not written by a pad */ }
  }
}, 300);
const clamp = (svg, value) => Math.min(Math.max(value, number(svg, "low")), number(svg, "high"));
let drawing = null, lastPlace = null, hand = 0; // hand: number of the pointer that draws
const draw = (svg, e) => {
  const box = svg.getBoundingClientRect(), view = svg.viewBox.baseVal;
  const x = ((e.clientX - box.left) / box.width) * view.width, y = ((e.clientY - box.top) / box.height) * view.height;
  const fraction = (x - number(svg, "left")) / (number(svg, "right") - number(svg, "left"));
  const k = Math.min(Math.max(Math.round(fraction * (COUNT - 1)), 0), COUNT - 1);
  const height = (number(svg, "bottom") - y) / (number(svg, "bottom") - number(svg, "top"));
  const value = clamp(svg, number(svg, "low") + height * (number(svg, "high") - number(svg, "low")));
  const { values } = svg.vsmrcDrawn, from = lastPlace ?? [k, value];
  for (let j = Math.min(from[0], k); j <= Math.max(from[0], k); j++) // a quick hand leaves out places
    values[j] = from[0] === k ? value : from[1] + ((value - from[1]) * (j - from[0])) / (k - from[0]);
  lastPlace = [k, value];
  svg.vsmrcDrawn.at = k;
  show(svg);
};
document.addEventListener("pointerdown", (e) => {
  const svg = e.button === 0 && padOf(e);
  if (!svg) return;
  drawing = svg, lastPlace = null, hand = e.pointerId;
  svg.setPointerCapture(e.pointerId);
  svg.focus();
  draw(svg, e);
  e.preventDefault();
}, true);
const lift = () => { if (drawing) send(drawing); drawing = null; };
document.addEventListener("pointermove", (e) => {
  if (e.pointerId !== hand) return;
  if (e.pointerType === "mouse" && e.buttons === 0) lift(); // its button went up elsewhere
  if (drawing) draw(drawing, e);
}, true);
for (const kind of ["pointerup", "pointercancel"])
  document.addEventListener(kind, (e) => { if (e.pointerId === hand) lift(); }, true);
document.addEventListener("keydown", (e) => {
  const svg = padOf(e);
  if (!svg || !/^Arrow/.test(e.key)) return;
  const pad = svg.vsmrcDrawn, step = ((number(svg, "high") - number(svg, "low")) * (e.shiftKey ? 10 : 2)) / 100;
  if (e.key === "ArrowLeft") pad.at = Math.max(pad.at - 1, 0);
  else if (e.key === "ArrowRight") pad.at = Math.min(pad.at + 1, COUNT - 1);
  else {
    const now = course(pad.values)[pad.at] ?? (number(svg, "low") + number(svg, "high")) / 2;
    pad.values[pad.at] = clamp(svg, now + (e.key === "ArrowUp" ? step : -step));
    send(svg);
  }
  show(svg);
  e.preventDefault();
  e.stopPropagation();
}, true);
for (const kind of ["focusin", "focusout"])
  document.addEventListener(kind, (e) => { const svg = padOf(e); if (svg) setTimeout(() => show(svg)); }, true);
// The next step begins at its top.
let shownStep = null;
setInterval(() => {
  const head = document.querySelector(".vs-lesson[data-step]");
  if (!head || head.dataset.step === shownStep) return;
  if (shownStep !== null) head.scrollIntoView({ block: "start" });
  shownStep = head.dataset.step;
}, 200);
