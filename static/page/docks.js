// The edges of the docks by keyboard: viser's answer to a mouse only. An arrow key moves one as a mouse would. And their
// widths in small windows.
const STEP = 24; // px
const SIDES = { left: "width of the plots", right: "width of the controls" };
const width = (edge) => Math.round(edge.parentElement.getBoundingClientRect().width);
setInterval(() => {
  for (const edge of document.querySelectorAll("[data-dock-region-resize]")) {
    const told = {
      role: "separator", tabindex: "0", "aria-orientation": "vertical", "aria-label": SIDES[edge.dataset.dockRegionResize],
      "aria-valuemin": "0", "aria-valuemax": `${innerWidth}`, "aria-valuenow": `${width(edge)}`, "aria-valuetext": `${width(edge)} pixels`,
    };
    for (const [name, value] of Object.entries(told)) if (edge.getAttribute(name) !== value) edge.setAttribute(name, value);
  }
}, 500);
// as a mouse does, by so many px to the right
const pull = (edge, by) => {
  const { left, right, top, height } = edge.getBoundingClientRect(), from = (left + right) / 2;
  const at = (clientX) => ({ bubbles: true, cancelable: true, button: 0, buttons: 1, pointerId: 1, clientX, clientY: top + height / 2 });
  edge.firstElementChild.dispatchEvent(new PointerEvent("pointerdown", at(from)));
  window.dispatchEvent(new PointerEvent("pointermove", at(from + by)));
  window.dispatchEvent(new PointerEvent("pointerup", { ...at(from + by), buttons: 0 }));
};
// In a small window both docks are narrower, unless the user has pulled them, so that the scene keeps room for the arm.
// In an upright one, as on a tablet, the plots stand above the scene (page.css).
// px: elsewhere, at least, and of the window, that are for the others
const MOST = { left: 404, right: 400 }, LEAST = { left: 276, right: 340 }, REST = { left: 720, right: 676 };
const pulled = new Set(); // sides that the user has pulled
const edgeOf = (e) => (e.target instanceof Element ? e.target.closest("[data-dock-region-resize]") : null);
document.addEventListener("pointerdown", (e) => { if (e.isTrusted && edgeOf(e)) pulled.add(edgeOf(e).dataset.dockRegionResize); }, true);
const phone = matchMedia("(max-width: 36em)"); // viser's layout for a phone
const portrait = matchMedia("(min-width: 36.01em) and (max-width: 1100px) and (orientation: portrait)"); // as in page.css
const share = () => {
  const root = document.documentElement, controls = document.querySelector("[data-dock-region=right]")?.offsetWidth ?? 0;
  const staged = root.matches("[data-stage]"), upright = !staged && portrait.matches;
  root.toggleAttribute("data-upright", upright && !!document.querySelector("[data-dock-region-resize=left]"));
  root.style.setProperty("--vs-controls-width", `${controls}px`);
  if (phone.matches || staged) return;
  for (const edge of document.querySelectorAll("[data-dock-region-resize]")) {
    const side = edge.dataset.dockRegionResize, is = width(edge);
    if (is < 60 || pulled.has(side) || (upright && side === "left")) continue; // closed, folded or above the scene
    const wanted = Math.min(MOST[side], Math.max(LEAST[side], innerWidth - REST[side]));
    if (Math.abs(wanted - is) > 2) pull(edge, side === "left" ? wanted - is : is - wanted);
  }
};
setInterval(share, 300);
// The controls fold away, and stay: viser would take them down, and with them the timeline and the buttons over the scene.
const FOLD = '[data-dock-region-collapse="right"]', page = document.documentElement;
const folded = () => page.matches("[data-folded]");
const folds = (e) =>
  e.target instanceof Element && (e.target.closest(FOLD) || (folded() && e.target.matches('[data-dock-region="right"]')));
const fold = (e) => {
  e.preventDefault();
  e.stopPropagation();
  if (!e.repeat) page.toggleAttribute("data-folded"); // a key that is held folds once
};
for (const kind of ["pointerdown", "pointerup"]) document.addEventListener(kind, (e) => { if (folds(e)) e.stopPropagation(); }, true);
document.addEventListener("click", (e) => { if (folds(e)) fold(e); }, true);
document.addEventListener("keydown", (e) => { if (folds(e) && /^(Enter| )$/.test(e.key)) fold(e); }, true);
setInterval(() => {
  if (phone.matches) page.removeAttribute("data-folded"); // it has no handle to take it back
  const open = !folded(), name = open ? "Collapse panel area" : "Expand panel area";
  for (const handle of document.querySelectorAll(FOLD)) {
    if (handle.ariaExpanded !== String(open)) handle.ariaExpanded = String(open);
    if (handle.ariaLabel !== name) handle.ariaLabel = name;
    const tip = handle.matches(":hover") && document.querySelector(".mantine-Tooltip-tooltip");
    if (tip && !open && tip.textContent === "Collapse") tip.textContent = "Expand";
  }
}, 300);
document.addEventListener("keydown", (e) => {
  const edge = edgeOf(e);
  if (!edge || !/^Arrow(Left|Right)$/.test(e.key)) return;
  e.preventDefault();
  e.stopPropagation();
  pulled.add(edge.dataset.dockRegionResize);
  pull(edge, e.key === "ArrowLeft" ? -STEP : STEP);
}, true);
// viser's tabs hear a pointer that does not move, and the key Enter, but no click; on a phone they are buttons, which do.
window.vsmrcOpenTab = (tab) => {
  tab?.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true, cancelable: true }));
  if (tab?.matches(".mantine-Tabs-tab")) tab.click();
};
