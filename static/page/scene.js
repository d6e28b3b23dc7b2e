// Where the scene is, between docks of whatever width, as variables of the style sheet.
const place = () => {
  const box = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
  for (const side of box ? ["left", "top", "width", "height"] : [])
    document.documentElement.style.setProperty(`--vs-scene-${side}`, `${Math.round(box[side])}px`);
  document.documentElement.toggleAttribute("data-narrow", !!box && box.width < 180); // no room for the equation
};
setInterval(place, 200);
window.addEventListener("resize", () => requestAnimationFrame(place));
window.addEventListener("click", (e) => {
  const button = e.target.closest?.(".vs-legend-button");
  if (button) button.ariaExpanded = String(document.documentElement.toggleAttribute("data-legend"));
});
