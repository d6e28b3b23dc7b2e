// What viser does not tell the server: which tabs of plots and of controls are on the screen, and how large the scene
// is there; viser tells how many pixels it draws, which depends on the machine (app/dashboard/transport/visible_parts.py).
const onScreen = (mark) => {
  const { width, height } = mark.closest("[data-dock-group]")?.getBoundingClientRect() ?? { width: 99, height: 99 };
  return mark.checkVisibility() && width > 40 && height > 40;
};
// viser sends one message in 50 ms, and of those that wait only the last: what the user does comes first.
const QUIET = 200; // ms
let reported = null, lastInput = -QUIET;
const report = () => {
  if (performance.now() - lastInput < QUIET) return;
  const input = document.querySelector("div:has(> .vs-visible) + div input");
  if (!input) return;
  const seen = [...document.querySelectorAll(".vs-plots, .vs-panel")].filter(onScreen).map((mark) => mark.dataset.plots);
  const tabs = document.hidden ? "-" : seen.join(","); // "-": AWAY in visible_parts.py
  const { width, height } = document.querySelector("canvas[data-engine]")?.getBoundingClientRect() ?? { width: 0, height: 0 };
  const view = `${tabs}#${Math.round(width)}x${Math.round(height)}`;
  if (reported && reported.input === input && reported.view === view) return;
  reported = { input, view };
  window.vsmrcEnter(input, `${view}#${Math.random()}`);
};
document.addEventListener("visibilitychange", report);
// points.js has come too late for a plot's data: a report brings them whole
let requested = -Infinity;
window.addEventListener("vsmrc-behind", () => {
  if (performance.now() - requested < 1000) return;
  requested = performance.now();
  reported = null;
  report();
});
for (const kind of ["pointerdown", "pointermove", "keydown"])
  document.addEventListener(kind, (e) => { if (e.buttons !== 0) lastInput = performance.now(); }, true);
for (const kind of ["pointerup", "keyup"])
  document.addEventListener(kind, () => { lastInput = performance.now(); setTimeout(report, QUIET + 10); }, true);
setInterval(report, 400);
