// Where the scene is, between docks of whatever width, as variables of the style sheet.
const phone = matchMedia("(max-width: 36em)");
const PREVIEW = 460; // px that the window of a preview takes in a wide scene (page.css), with the gaps beside it
const place = () => {
  const box = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
  for (const side of box ? ["left", "top", "width", "height"] : [])
    document.documentElement.style.setProperty(`--vs-scene-${side}`, `${Math.round(box[side])}px`);
  // the gateway's bar is above all that lies over the scene
  const bar = document.querySelector(".vg-bar")?.getBoundingClientRect();
  const under = Math.max(box?.top ?? 0, bar && box && bar.left < box.right && bar.right > box.left ? bar.bottom : 0);
  document.documentElement.style.setProperty("--vs-over-top", `${Math.round(under)}px`);
  // what lies over it stands one below the other: buttons, the window of a held slider, messages; and nothing is scrolled
  // under the status line
  const narrow = !!box && box.width < 180; // no room for the equation, nor for the timeline
  const inPanel = { acts: phone.matches, timeline: narrow || phone.matches };
  const high = (part) => (!inPanel[part] && document.querySelector(`.vs-${part}`)?.offsetHeight) || 0;
  for (const part of ["acts", "strip", "status", "timeline"])
    document.documentElement.style.setProperty(`--vs-${part}-height`, `${high(part)}px`);
  // below the window of a held slider, which a message must not move under the mouse
  const held = document.querySelector("[data-floating-window]:has(.vs-held)")?.getBoundingClientRect();
  const room = box && held?.height ? box.bottom - high("timeline") - 24 - held.bottom : 0; // between the window and the timeline
  const above = room > Math.max(high("strip"), 48) && held.top < box.top + 0.4 * box.height;
  if (above) document.documentElement.style.setProperty("--vs-strip-top", `${Math.round(held.bottom + 8)}px`);
  else document.documentElement.style.removeProperty("--vs-strip-top");
  // over the windows, unless one of them lies over the panel
  const panel = document.querySelector("[data-dock-region]:has(.vs-strip)")?.getBoundingClientRect();
  const beside = [...document.querySelectorAll("[data-floating-window]")].every((w) => w.getBoundingClientRect().right <= panel?.left + 1);
  document.documentElement.toggleAttribute("data-over", !!panel && beside);
  document.documentElement.toggleAttribute("data-narrow", narrow);
  // the equation and a preview, which lies at the right end, do not fit beside each other
  const equation = document.querySelector("[data-floating-window]:has(.vs-equation)")?.getBoundingClientRect();
  document.documentElement.toggleAttribute("data-crowded", !!box && !!equation && box.right - equation.right < PREVIEW);
};
setInterval(place, 200);
// A selection that begins in a message ends with it.
const elementOf = (node) => (node instanceof Element ? node : node?.parentElement);
document.addEventListener("pointerup", () => {
  const { anchorNode, anchorOffset, focusNode, focusOffset } = getSelection();
  const message = elementOf(anchorNode)?.closest(".vs-strip .vs-message");
  if (!message || message.contains(focusNode)) return;
  const whole = document.createRange();
  whole.selectNodeContents(message);
  const behind = whole.comparePoint(focusNode, focusOffset) > 0;
  getSelection().setBaseAndExtent(anchorNode, anchorOffset, message, behind ? message.childNodes.length : 0);
}, true);
// The server hears how large the picture is, for a file of it: viser tells that before the picture has its new size, and
// not at all when it draws more coarsely on a slow machine.
let sized = "";
setInterval(() => {
  const { canvas, sendCamera } = window.__viserMutable ?? {};
  if (!canvas || !sendCamera || sized === `${canvas.width} x ${canvas.height}`) return;
  sized = `${canvas.width} x ${canvas.height}`;
  sendCamera();
}, 300);
// The equation stays between the docks when one is pulled: viser places its window before that has its new width. A pull
// by docks.js is no press: its end is told to the window only.
let pressed = false;
for (const [kind, is] of [["pointerdown", true], ["pointerup", false], ["pointercancel", false]])
  document.addEventListener(kind, (e) => { if (e.isTrusted) pressed = is; }, true);
setInterval(() => {
  const equation = document.querySelector("[data-floating-window]:has(.vs-equation)");
  const scene = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
  if (!equation || !scene || pressed) return;
  const moved = parseFloat(equation.style.translate) || 0, { left, right } = equation.getBoundingClientRect();
  const by = "stage" in document.documentElement.dataset ? 0
    : Math.round(Math.max(scene.left - left + moved, Math.min(0, scene.right - right + moved)));
  if (by !== moved) equation.style.translate = by ? `${by}px 0` : "";
}, 200);
window.addEventListener("resize", () => requestAnimationFrame(place));
window.addEventListener("click", (e) => {
  const button = e.target.closest?.(".vs-legend-button");
  if (button) button.ariaExpanded = String(document.documentElement.toggleAttribute("data-legend"));
});

// A scene that is slender shows as much from left to right as one that is not: a camera's field is measured upwards.
const SLENDER = 0.8; // width over height
let upwards = null; // field of the camera elsewhere, degrees
setInterval(() => {
  const { camera, canvas, requestRender } = window.__viserMutable ?? {};
  if (!camera?.isPerspectiveCamera || !canvas?.clientHeight) return;
  upwards ??= camera.fov;
  const wider = Math.max(1, (SLENDER * canvas.clientHeight) / canvas.clientWidth);
  const fov = (360 / Math.PI) * Math.atan(wider * Math.tan((upwards * Math.PI) / 360));
  if (Math.abs(fov - camera.fov) < 0.01) return;
  camera.fov = fov;
  camera.updateProjectionMatrix();
  requestRender();
}, 300);

// Force arrows and the ball that can be dragged stand before all else, the arm too, for which viser has no option: they
// are drawn last but for labels, on a depth that the first of them clears. The ball hides no arrow.
const FIRST = /^\/(force\/\w+|hand\/handle)$/, BALL = "/hand/handle", LATE = 9000; // labels come at 10,000
let cleared = -1; // number of the picture
const forward = (mesh, hides) => {
  const prepare = mesh.onBeforeRender;
  mesh.renderOrder = LATE;
  mesh.onBeforeRender = function (renderer, ...rest) {
    if (renderer.info.render.frame !== cleared) {
      cleared = renderer.info.render.frame;
      renderer.state.buffers.depth.setMask(true); // what was drawn before may have turned it off
      renderer.clearDepth();
    }
    prepare.call(this, renderer, ...rest);
  };
  // transparent: drawn after all that is opaque
  Object.assign(mesh.material, { transparent: true, depthWrite: hides, needsUpdate: true });
};
setInterval(() => {
  for (const [name, node] of Object.entries(window.__viserMutable?.nodeRefFromName ?? {}))
    if (FIRST.test(name))
      node?.traverse((part) => { if (part.isMesh && part.renderOrder !== LATE) forward(part, name !== BALL); });
}, 300);
