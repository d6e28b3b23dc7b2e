// A tile of the robustness map is chosen, by mouse or keyboard: its number is written into the hidden field behind it.
const openTile = (target) => {
  const tile = target instanceof Element && target.closest(".vs-tiles [data-point]");
  const input = tile && document.querySelector("div:has(> .vs-tile-field) + div input");
  if (!tile || !input) return false;
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, `${tile.dataset.point} ${Math.random()}`);
  input.dispatchEvent(new Event("input", { bubbles: true }));
  return true;
};
document.addEventListener("pointerdown", (e) => void openTile(e.target), true); // a click may lose its tile, which is drawn anew
document.addEventListener("keydown", (e) => {
  if ((e.key === "Enter" || e.key === " ") && openTile(e.target)) {
    e.preventDefault();
    e.stopPropagation();
  }
}, true);
