// Presentation: the scene, one plot, the sliders moved last, and the equation, in large type; in a lesson the scene, one
// plot and the step of the lesson. V begins and ends it, the button of the help begins it, and Esc ends it. The plot is the one that was pressed last, else
// the first one; two buttons, and the keys "," and ".", lead to the one before and the next, through all tabs of plots.
// Where no slider was moved and the open tab has none, the first tab of the controls is opened meanwhile.
const page = document.documentElement, MOST = 3;
const OPEN = "[data-dock-group] [data-dock-group] form:has(.mantine-Slider-root)"; // in the tab that is open
const CLOSED = "[style*='display: none']"; // viser's tabs that are not open
const CHOSEN = "div:has(> .vs-chosen) ~ form"; // app/dashboard/widgets/fields/chosen_sliders.py
const TABS = "[role=tablist]:has(> :nth-child(10)) [role=tab]"; // of the controls
const PLOT_TABS = "[data-dock-region=left] [data-dock-group]:has(.vs-plots) [role=tab]";
let pressed = null, left = null; // the plot; the tab that is opened again when the presentation ends
let elsewhere = 0; // which plot of a tab none of whose plots was pressed: 0 for the first, -1 for the last
for (const kind of ["pointerdown", "focusin"])
  document.addEventListener(kind, (e) => {
    if (e.target instanceof Element) pressed = e.target.closest(".uplot-container") ?? pressed;
  }, true);
const allPlots = () => [...document.querySelectorAll(".uplot-container")];
const inOpenTab = (box) => !box.closest(CLOSED); // those of a tab that was open before stay in the page
const openTab = () => document.querySelector(`${PLOT_TABS}[aria-selected=true]`);
const onStage = () => "stage" in page.dataset;
const shown = document.createElement("span"); // which plot it is
const mark = (all, chosen) => { for (const e of all) e.toggleAttribute("data-staged", chosen.includes(e)); };
const choose = () => {
  const moved = [...document.querySelectorAll(CHOSEN)], open = [...document.querySelectorAll(OPEN)];
  const free = open.filter((row) => row.querySelector("input:not(:disabled)") && !row.closest(CLOSED));
  const lessons = [...document.querySelectorAll(".mantine-Paper-root:has(.vs-lesson[data-step])")];
  mark(lessons, lessons);
  mark([...moved, ...open], lessons.length ? [] : moved.length ? moved : free.slice(0, MOST));
  const boxes = allPlots(), drawn = boxes.filter(inOpenTab);
  const plot = drawn.includes(pressed) ? pressed : drawn.at(elsewhere), tab = openTab();
  mark(boxes, [plot]);
  const place = `${tab?.textContent ?? ""} ${drawn.indexOf(plot) + 1} / ${drawn.length}`;
  if (shown.textContent !== place) shown.textContent = place;
  return lessons.length > 0 || moved.length > 0 || free.length > 0;
};
const staged = new Map(); // the height of each plot before
const TYPE = 1.6; // of the plot
const AIR = 24; // px between the sliders and the equation
let tried = ""; // what decided last where the equation lies
// under the sliders where there is room for it, else under plot and scene
const placeEquation = (equation) => {
  const column = onStage() && equation && document.querySelector("[data-dock-region=right]");
  if (!column) {
    tried = "";
    page.removeAttribute("data-beside");
    return;
  }
  const parts = [...column.querySelectorAll(".vs-status, .vs-minute, form[data-staged]")].filter((part) => part.checkVisibility());
  const foot = Math.round(Math.max(...parts.map((part) => part.getBoundingClientRect().bottom)));
  const now = [innerWidth, innerHeight, foot, equation.textContent].join();
  if (now === tried) return;
  tried = now;
  page.setAttribute("data-beside", "");
  const math = equation.querySelector("math");
  const whole = math && math.scrollWidth <= math.clientWidth + 1 && math.scrollHeight <= math.clientHeight + 1;
  page.toggleAttribute("data-beside", whole && foot + AIR + equation.offsetHeight <= innerHeight);
};
const fill = () => {
  const equation = document.querySelector("[data-floating-window]:has(.vs-equation)");
  placeEquation(equation);
  const below = page.matches("[data-beside]") ? 0 : equation?.offsetHeight ?? 0; // what it leaves plot and scene
  page.style.setProperty("--vs-equation-height", `${below}px`);
  for (const chart of staged.keys()) if (!chart.root.isConnected) staged.delete(chart); // viser has built it anew
  for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {})) {
    const box = chart.root.closest(".uplot-container"), dock = box?.closest("[data-dock-group]"); // a phone has none
    const here = onStage() && dock && box.matches("[data-staged]");
    if (here && box.matches("[data-large]")) continue; // reading.js gives it its size
    if (!here && staged.has(chart)) {
      const height = staged.get(chart);
      staged.delete(chart);
      window.vsmrcType(chart, 1);
      chart.setSize({ width: chart.width, height });
    } else if (here) {
      if (!staged.has(chart)) staged.set(chart, chart.height);
      if (chart.vsmrcFactor !== TYPE) window.vsmrcType(chart, TYPE);
      const group = dock.getBoundingClientRect(), own = chart.root.getBoundingClientRect();
      const height = Math.round(group.bottom - own.top - (own.height - chart.height) - 24);
      if (height > 60 && Math.abs(height - chart.height) > 2) chart.setSize({ width: chart.width, height });
    }
  }
};
const toggle = () => {
  page.toggleAttribute("data-stage");
  const tabs = [...document.querySelectorAll(TABS)];
  if (!onStage()) {
    for (const e of document.querySelectorAll("[data-staged]")) e.removeAttribute("data-staged");
    window.vsmrcOpenTab(left);
    left = null;
  } else if (!choose()) {
    left = tabs.find((tab) => tab.ariaSelected === "true") ?? null;
    window.vsmrcOpenTab(tabs[0]);
  }
  fill();
};
// To the plot so many places on, of this tab or of the next ones.
const turn = (by) => {
  const drawn = allPlots().filter(inOpenTab);
  const next = drawn[drawn.findIndex((box) => box.matches("[data-staged]")) + by];
  if (next) {
    pressed = next;
  } else {
    const tabs = [...document.querySelectorAll(PLOT_TABS)];
    [pressed, elsewhere] = [null, by < 0 ? -1 : 0];
    window.vsmrcOpenTab(tabs.at((tabs.indexOf(openTab()) + by) % tabs.length));
  }
  choose();
  fill();
};
const button = (className, textContent, title, press) => {
  const made = Object.assign(document.createElement("button"), { className, type: "button", textContent, title, ariaLabel: title });
  made.addEventListener("click", () => { made.blur(); if (onStage()) press(); });
  return made;
};
document.body.append(button("vs-leave", "×", "Leave the presentation (Esc, V)", toggle));
const turns = Object.assign(document.createElement("nav"), { className: "vs-turns", ariaLabel: "plots" });
turns.append(button("", "‹", "The plot before (,)", () => turn(-1)), shown, button("", "›", "The next plot (.)", () => turn(1)));
document.body.append(turns);
document.addEventListener("click", (e) => {
  if (!(e.target instanceof Element && e.target.closest("[data-presents]"))) return;
  e.target.closest("dialog")?.close(); // of who watches
  toggle();
});
document.body.addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.repeat || e.defaultPrevented || document.querySelector(".vs-help") || window.vsmrcTyping(e)) return;
  if (/^v$/i.test(e.key) || (e.key === "Escape" && onStage())) toggle();
  else if (onStage() && (e.key === "," || e.key === ".")) turn(e.key === "," ? -1 : 1);
});
setInterval(() => { if (onStage()) { choose(); fill(); } }, 300);
