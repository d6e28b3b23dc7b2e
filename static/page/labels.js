// Labels of the scene as text of the page: viser draws them where their points are, cut at the scene's edge, one over the
// other, and as large in a presentation as anywhere. Here each stands beside its point, wholly within the scene, and the
// later one gives way. On a picture that is exported viser's own stand.
const EDGE = 4, OWN = 10_001; // px; viser's order of what is drawn: that of labels
const OVER = ".vs-acts button, .vs-legend-button, .vs-coarse-button, .vs-legend, .vs-strip .vs-message, .vs-timeline"; // lies over the scene
const layer = document.createElement("div");
layer.className = "vs-labels";
layer.ariaHidden = "true"; // plots and legend say the same, and not ten times a second
const written = new Map(); // by node: { box, text, width, height }
const label = (name, tree, text) => {
  if (!written.has(name)) {
    const box = document.createElement("span"), [r, g, b] = tree[parentOf(name)]?.message.props.colors ?? [];
    box.dataset.of = name;
    if (b !== undefined) box.style.borderColor = `rgb(${r}, ${g}, ${b})`; // of its arrow
    layer.append(box);
    written.set(name, { box, text: "" });
  }
  const label = written.get(name);
  if (label.text !== text) label.box.textContent = label.text = text;
  return label;
};
const parentOf = (name) => name.slice(0, name.lastIndexOf("/"));
let obstacles = []; // boxes of what lies over the scene, in its coordinates
const look = () => {
  const scene = layer.parentElement?.getBoundingClientRect();
  if (!scene) return;
  obstacles = [...document.querySelectorAll(OVER)].filter((each) => each.checkVisibility()).map((each) => {
    const { left, top, right, bottom } = each.getBoundingClientRect();
    return { left: left - scene.left, top: top - scene.top, right: right - scene.left, bottom: bottom - scene.top };
  });
};
const keep = (value, least, most) => Math.max(least, Math.min(value, most));
const crosses = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
// beside the point, on the side that viser's anchor names: "top-left" is the label's corner that is there
const beside = (x, y, { width, height }, anchor) => {
  const [vertical, horizontal] = anchor.split("-");
  const left = x - (horizontal === "right" ? width : horizontal === "left" ? 0 : width / 2);
  const top = y - (vertical === "bottom" ? height : vertical === "top" ? 0 : height / 2);
  return { left, top, right: left + width, bottom: top + height };
};
const place = (at, there, within) => {
  const moved = (left, top) => ({ left, top, right: left + at.right - at.left, bottom: top + at.bottom - at.top });
  const high = at.bottom - at.top;
  const kept = (each) => moved(keep(each.left, EDGE, within.width - EDGE - (each.right - each.left)), keep(each.top, EDGE, within.height - EDGE - high));
  const first = kept(at), free = (each) => !there.some((other) => crosses(each, other));
  // else right above or below what is in the way, whichever is nearer
  const others = there.flatMap((other) => [kept(moved(first.left, other.top - high - 1)), kept(moved(first.left, other.bottom + 1))]);
  others.sort((a, b) => Math.abs(a.top - first.top) - Math.abs(b.top - first.top));
  return [first, ...others].find(free) ?? null;
};
const write = (camera) => {
  const { canvas, nodeRefFromName, nodePoseData } = window.__viserMutable, tree = window.__viserSceneTree?.getState() ?? {};
  if (layer.parentElement !== canvas.parentElement) canvas.parentElement.append(layer);
  const within = { width: canvas.clientWidth, height: canvas.clientHeight };
  const shown = Object.entries(tree).filter(([name, node]) => node?.message.type === "LabelMessage" && node.effectiveVisibility && nodeRefFromName[parentOf(name)]);
  const texts = shown.map(([name, node]) => label(name, tree, node.message.props.text)); // written first, then measured
  const there = [...obstacles], placed = new Set();
  shown.forEach(([name, node], i) => {
    const at = camera.position.clone().set(...(nodePoseData[name]?.position ?? [0, 0, 0]));
    at.applyMatrix4(nodeRefFromName[parentOf(name)].matrixWorld).project(camera);
    if (Math.max(Math.abs(at.x), Math.abs(at.y), Math.abs(at.z)) > 1) return; // not in the picture
    const { box } = texts[i], size = { width: box.offsetWidth, height: box.offsetHeight };
    const found = place(beside((within.width * (1 + at.x)) / 2, (within.height * (1 - at.y)) / 2, size, node.message.props.anchor), there, within);
    if (!found) return;
    there.push(found);
    placed.add(box);
    box.style.translate = `${Math.round(found.left)}px ${Math.round(found.top)}px`;
  });
  for (const { box } of written.values()) box.toggleAttribute("data-shown", placed.has(box));
};
let followed = null; // the scene whose pictures are followed
setInterval(() => {
  const { scene } = window.__viserMutable ?? {};
  look();
  if (!scene || scene === followed) return;
  followed = scene;
  let own = null; // group of viser's labels
  scene.onBeforeRender = (_, all, camera) => {
    if (!own) all.traverse((each) => { if (each.renderOrder === OWN) own = each.parent; });
    const onPage = camera === window.__viserMutable?.camera;
    if (own) own.visible = !onPage;
    if (onPage) write(camera);
  };
}, 200);
