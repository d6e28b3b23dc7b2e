// Coarse arms: a browser that draws without a graphics card takes most of a picture's time for the arm's triangles. Where
// it does, or where pictures come slowly, this page draws arms with fewer of them; a button says so, and takes it back.
const CELL = 0.015, FEW = 400; // m; triangles that are not worth it
const SLOW = 10, SPAN = 2000, SLOW_SPANS = 3, FEWER = 0.6; // pictures per second, ms, -, -
const button = () => document.querySelector(".vs-coarse-button");
const bySoftware = () => {
  const gl = document.querySelector("canvas[data-engine]")?.getContext("webgl2");
  const name = gl?.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER) ?? "";
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
};
// Vertices in one cell that look the same way become the first of them; what has then no area is left out.
const thinned = (geometry) => {
  const { position, normal } = geometry.attributes, of = new Map(), kept = [];
  const same = Uint32Array.from({ length: position.count }, (_, i) => {
    const at = [position.getX(i), position.getY(i), position.getZ(i)].map((x) => Math.round(x / CELL));
    const key = [...at, ...[normal.getX(i), normal.getY(i), normal.getZ(i)].map(Math.round)].join();
    if (!of.has(key)) of.set(key, i);
    return of.get(key);
  });
  const all = geometry.index.array;
  for (let i = 0; i < all.length; i += 3) {
    const [a, b, c] = [same[all[i]], same[all[i + 1]], same[all[i + 2]]];
    if (a !== b && b !== c && c !== a) kept.push(a, b, c);
  }
  return new geometry.index.constructor(new Uint32Array(kept), 1);
};
const indices = new WeakMap(); // of a geometry, { whole, thin }
const draw = (coarse) => {
  const scene = window.__viserMutable;
  for (const [name, node] of Object.entries(scene?.nodeRefFromName ?? {})) {
    const mesh = /^\/robot_/.test(name) ? node?.children.find((each) => each.isMesh) : null, geometry = mesh?.geometry;
    if (!geometry?.index || !geometry.attributes.normal) continue;
    const known = indices.get(geometry);
    const whole = known && geometry.index === known.thin ? known.whole : geometry.index;
    if (whole.count < 3 * FEW || (!coarse && !known)) continue;
    if (known?.whole !== whole) indices.set(geometry, { whole, thin: thinned(geometry) });
    const wanted = coarse ? indices.get(geometry).thin : whole;
    if (geometry.index === wanted) continue;
    geometry.setIndex(wanted);
    scene.requestRender();
  }
};
let chosen = null, software = null; // by the button, by the name of what draws; null as long as unknown
let found = 0, slow = 0, pictures = 0, since = performance.now(); // found: how often pictures have come slowly
const count = (now) => {
  pictures += 1;
  if (now - since > SPAN) {
    const told = !document.hidden && now - since < 3 * SPAN; // else the window was hidden meanwhile
    slow = told && (1000 * pictures) / (now - since) < SLOW ? slow + 1 : 0;
    [pictures, since] = [0, now];
    if (slow === SLOW_SPANS) [found, slow] = [found + 1, 0];
  }
  requestAnimationFrame(count);
};
requestAnimationFrame(count);
let drawnWith = null; // pixels of the scene per pixel of the window; null: viser's own choice, 0.75 to 1
setInterval(() => {
  if (!document.querySelector("canvas[data-engine]")) return;
  software ??= bySoftware();
  const coarse = chosen ?? (software || found > 0);
  draw(coarse);
  // where that was not enough, fewer pixels
  const fixedDpr = coarse && found > Number(!software) ? FEWER * devicePixelRatio : null;
  if (fixedDpr !== drawnWith) window.__viserTestpoints?.devSettings.set({ fixedDpr: (drawnWith = fixedDpr) });
  const there = button();
  if (!there) return;
  there.hidden = !(coarse || chosen !== null);
  there.ariaPressed = String(coarse);
  // the button says what viser's own message does, which lies over the scene until it is closed
  if (coarse) document.querySelector("#webgl-software-rendering button")?.click();
}, 500);
document.addEventListener("click", (e) => {
  if (e.target instanceof Element && e.target.closest(".vs-coarse-button")) chosen = button().ariaPressed !== "true";
});
