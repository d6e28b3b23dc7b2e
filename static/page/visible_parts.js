// What viser does not tell the server: which tabs of plots and of controls are on the screen, and how large the scene
// is there; viser tells how many pixels it draws, which depends on the machine (app/dashboard/transport/visible_parts.py).
const type = (input, text) => {
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, text);
  input.dispatchEvent(new Event("input", { bubbles: true }));
};
const onScreen = (mark) => {
  const { width, height } = mark.closest("[data-dock-group]")?.getBoundingClientRect() ?? { width: 99, height: 99 };
  return mark.checkVisibility() && width > 40 && height > 40;
};
// viser sends one message in 50 ms, and of those that wait only the last: what the user does comes first.
const QUIET = 200; // ms
let told = null, acted = -QUIET;
const report = () => {
  if (performance.now() - acted < QUIET) return;
  const input = document.querySelector("div:has(> .vs-visible) + div input");
  if (!input) return;
  const seen = [...document.querySelectorAll(".vs-plots, .vs-panel")].filter(onScreen).map((mark) => mark.dataset.plots);
  const tabs = document.hidden ? "-" : seen.join(","); // "-": AWAY in visible_parts.py
  const { width, height } = document.querySelector("canvas[data-engine]")?.getBoundingClientRect() ?? { width: 0, height: 0 };
  const view = `${tabs}#${Math.round(width)}x${Math.round(height)}`;
  if (told && told.input === input && told.view === view) return;
  told = { input, view };
  type(input, `${view}#${Math.random()}`);
};
document.addEventListener("visibilitychange", report);
// points.js has come too late for a plot's data: a report brings them whole
let asked = -Infinity;
window.addEventListener("vsmrc-behind", () => {
  if (performance.now() - asked < 1000) return;
  asked = performance.now();
  told = null;
  report();
});
for (const kind of ["pointerdown", "pointermove", "keydown"])
  document.addEventListener(kind, (e) => { if (e.buttons !== 0) acted = performance.now(); }, true);
for (const kind of ["pointerup", "keyup"])
  document.addEventListener(kind, () => { acted = performance.now(); setTimeout(report, QUIET + 10); }, true);
setInterval(report, 400);
