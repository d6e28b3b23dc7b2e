// The edges of the docks by keyboard: viser's answer to a mouse only. An arrow key moves one as a mouse would.
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
document.addEventListener("keydown", (e) => {
  const edge = e.target instanceof Element && e.target.matches("[data-dock-region-resize]") ? e.target : null;
  if (!edge || !/^Arrow(Left|Right)$/.test(e.key)) return;
  e.preventDefault();
  e.stopPropagation();
  const { left, right, top, height } = edge.getBoundingClientRect(), from = (left + right) / 2, way = e.key === "ArrowLeft" ? -1 : 1;
  const at = (clientX) => ({ bubbles: true, cancelable: true, button: 0, buttons: 1, pointerId: 1, clientX, clientY: top + height / 2 });
  edge.firstElementChild.dispatchEvent(new PointerEvent("pointerdown", at(from)));
  window.dispatchEvent(new PointerEvent("pointermove", at(from + way * STEP)));
  window.dispatchEvent(new PointerEvent("pointerup", { ...at(from + way * STEP), buttons: 0 }));
}, true);
