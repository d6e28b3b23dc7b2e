// Canvases, which are the plots and the labels in the scene, know no style sheet: whatever family they are told, they
// get the page's.
const plain = Object.getOwnPropertyDescriptor(CanvasRenderingContext2D.prototype, "font");
Object.defineProperty(CanvasRenderingContext2D.prototype, "font", {
  ...plain,
  set(font) { plain.set.call(this, font.replace(/px .*$/, 'px "vsmrc text", sans-serif')); },
});
// what was drawn before the fonts were there
Promise.all(["12px", "bold 12px"].map((size) => document.fonts.load(`${size} "vsmrc text"`))).then(() => {
  for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {})) chart.redraw(false, true);
});
