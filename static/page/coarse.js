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
// Vertices in one cell move to the first of them, each with its own normal: so there is no crack, and an edge stays one.
// What has then no area is left out.
const thinned = (geometry) => {
  const { position, normal } = geometry.attributes, of = new Map(), kept = [];
  const first = Uint32Array.from({ length: position.count }, (_, i) => {
    const key = [position.getX(i), position.getY(i), position.getZ(i)].map((x) => Math.round(x / CELL)).join();
    if (!of.has(key)) of.set(key, i);
    return of.get(key);
  });
  const all = geometry.index.array, moved = position.clone();
  first.forEach((from, i) => moved.copyAt(i, position, from));
  for (let i = 0; i < all.length; i += 3) {
    const [a, b, c] = [first[all[i]], first[all[i + 1]], first[all[i + 2]]];
    if (a !== b && b !== c && c !== a) kept.push(all[i], all[i + 1], all[i + 2]);
  }
  const thin = new geometry.constructor();
  thin.setIndex(new geometry.index.constructor(new Uint32Array(kept), 1));
  thin.setAttribute("position", moved).setAttribute("normal", normal);
  thin.boundingSphere = geometry.boundingSphere;
  return thin;
};
const thins = new WeakMap(), wholes = new WeakMap(); // of a whole geometry its thin one, and the other way round
const draw = (coarse) => {
  const scene = window.__viserMutable;
  for (const [name, node] of Object.entries(scene?.nodeRefFromName ?? {})) {
    const mesh = /^\/robot_/.test(name) ? node?.children.find((each) => each.isMesh) : null;
    const whole = wholes.get(mesh?.geometry) ?? mesh?.geometry;
    if (!whole?.index || !whole.attributes.normal || whole.index.count < 3 * FEW) continue;
    if (coarse && !thins.has(whole)) {
      const thin = thinned(whole);
      thins.set(whole, thin);
      wholes.set(thin, whole);
      whole.addEventListener("dispose", () => thin.dispose()); // viser knows of the whole one only
    }
    const wanted = coarse ? thins.get(whole) : whole;
    if (mesh.geometry === wanted) continue;
    mesh.geometry = wanted;
    scene.requestRender();
  }
};
let chosen = null, software = null; // by the button, by the name of what draws; null as long as unknown
let found = 0, slow = 0, pictures = 0, since = performance.now(); // found: how often pictures have come slowly
const count = (now) => {
  pictures += 1;
  if (now - since > SPAN) {
    const valid = !document.hidden && now - since < 3 * SPAN; // else the window was hidden meanwhile
    slow = valid && (1000 * pictures) / (now - since) < SLOW ? slow + 1 : 0;
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
