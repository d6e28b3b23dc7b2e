// Reading a plot: its values under the crosshair, and the plot as large as there is room. viser's own enlargement is as
// low as the plot was.
const charts = () => Object.values(window.__viserTestpoints?.uplots ?? {}).map((entry) => entry.chart);
const values = document.createElement("div");
values.className = "vs-values";
values.hidden = true;
document.body.append(values);
const row = (name, value, color) => {
  const line = document.createElement("div"), told = document.createElement("b");
  line.append(`${name} `, told);
  told.textContent = `${+value.toPrecision(4)}`;
  line.style.color = color;
  return line;
};
const tell = (plot) => {
  const { idx, left, top } = plot.cursor, hovered = plot.over.matches(":hover");
  if (!hovered && values.vsmrcPlot !== plot) return;
  values.hidden = !hovered || idx == null || left < 0;
  if (values.hidden) return;
  values.vsmrcPlot = plot;
  const lines = plot.series.slice(1).map((series, i) => [series, plot.data[i + 1][idx], series.stroke?.(plot, i + 1)])
    .filter(([series, value]) => series.label && !/vs-unlisted/.test(series.class ?? "") && Number.isFinite(value))
    .map(([series, value, color]) => row(series.label, value, color));
  values.replaceChildren(row(plot.series[0].label, plot.data[0][idx], ""), ...lines);
  const over = plot.over.getBoundingClientRect(), { width, height } = values.getBoundingClientRect();
  const x = over.left + left + 14, y = over.top + top + 14;
  values.style.left = `${x + width < innerWidth ? x : x - width - 28}px`;
  values.style.top = `${Math.max(4, Math.min(y, innerHeight - height - 4))}px`;
};

const large = () => document.querySelector(".uplot-container[data-large]");
const fit = (plot) => {
  const box = plot.root.closest("[data-large]");
  if (!box) return;
  const rest = box.clientHeight - 12 - (plot.root.getBoundingClientRect().height - plot.height);
  if (Math.abs(rest - plot.height) > 2) setTimeout(() => plot.setSize({ width: plot.width, height: rest }));
};
const chartIn = (box) => charts().find((plot) => box.contains(plot.root));
const shrink = () => {
  const box = large(), plot = box && chartIn(box);
  if (!box) return;
  const height = Number(box.dataset.large);
  delete box.dataset.large;
  plot?.setSize({ width: plot.width, height });
};
const grow = (box) => {
  const plot = chartIn(box);
  if (!plot) return;
  box.dataset.large = plot.height;
  fit(plot);
};
document.addEventListener("click", (e) => {
  const box = e.target instanceof Element && e.target.closest(".uplot-container"), button = box && e.target.closest("button");
  if (!button && (!large() || box === large())) return;
  const again = box === large();
  if (button) e.stopPropagation();
  shrink();
  if (button && !again) grow(box);
}, true);
document.addEventListener("keydown", (e) => { if (e.key === "Escape") shrink(); }, true);

const read = new WeakSet();
setInterval(() => {
  for (const plot of charts().filter((plot) => !read.has(plot))) {
    read.add(plot);
    (plot.hooks.setCursor ??= []).push(tell);
    (plot.hooks.setSize ??= []).push(fit);
  }
  if (values.vsmrcPlot && !values.vsmrcPlot.root.isConnected) values.hidden = true;
}, 300);
