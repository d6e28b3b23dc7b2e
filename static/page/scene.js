// Where the scene is, between docks of whatever width, as variables of the style sheet.
const place = () => {
  const box = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
  for (const side of box ? ["left", "top", "width", "height"] : [])
    document.documentElement.style.setProperty(`--vs-scene-${side}`, `${Math.round(box[side])}px`);
  // what lies over it stands one below the other: buttons, messages, the window of a held slider; and nothing is scrolled
  // under the status line
  for (const part of ["acts", "strip", "status"]) {
    const high = document.querySelector(`.vs-${part}`)?.offsetHeight ?? 0;
    document.documentElement.style.setProperty(`--vs-${part}-height`, `${high}px`);
  }
  document.documentElement.toggleAttribute("data-narrow", !!box && box.width < 180); // no room for the equation
};
setInterval(place, 200);
window.addEventListener("resize", () => requestAnimationFrame(place));
window.addEventListener("click", (e) => {
  const button = e.target.closest?.(".vs-legend-button");
  if (button) button.ariaExpanded = String(document.documentElement.toggleAttribute("data-legend"));
});
