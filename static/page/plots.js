// What viser hands no option for: the preview is drawn lighter, and every line is dark enough for a light page.
// right of zero lies what has not happened: less of it
const dim = (plot) => {
  const { left, top, width, height } = plot.bbox, from = Math.max(plot.valToPos(0, "x", true), left);
  if (!(from < left + width - 1)) return;
  plot.ctx.save();
  plot.ctx.globalCompositeOperation = "destination-out";
  plot.ctx.fillStyle = "rgba(0, 0, 0, 0.5)";
  plot.ctx.fillRect(from + 1, top, left + width - from, height);
  plot.ctx.restore();
};
// 3:1 on white is a relative luminance of 0.3 at most. The lightest colours become the darkest, so that yellow and
// orange stay apart. viser makes every chart anew when the theme changes.
const pen = document.createElement("canvas").getContext("2d");
const onWhite = (color) => {
  if (typeof color !== "string") return color;
  pen.fillStyle = color; // "#rrggbb" or "rgba(r, g, b, a)" is what it reads back
  const hex = /^#(..)(..)(..)$/.exec(pen.fillStyle), found = hex ?? /(\d+), (\d+), (\d+), ([\d.]+)/.exec(pen.fillStyle);
  const light = found.slice(1, 4).map((c) => Math.pow((hex ? parseInt(c, 16) : +c) / 255, 2.2));
  const luminance = 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2];
  const share = luminance <= 0.28 ? 1 : (0.28 - 0.35 * (luminance - 0.28)) / luminance;
  const [r, g, b] = light.map((c) => Math.round(255 * Math.pow(share * c, 1 / 2.2)));
  return `rgba(${r}, ${g}, ${b}, ${hex ? 1 : found[4]})`;
};
const relight = (chart) => {
  for (const series of chart.series) {
    const own = series.stroke;
    if (typeof own === "function") series.stroke = (...asked) => onWhite(own(...asked));
  }
  for (const marker of chart.root.querySelectorAll(".u-legend .u-marker"))
    marker.style.borderColor = onWhite(marker.style.borderColor);
};
const listed = new WeakSet();
const enlist = (entry) => {
  if (listed.has(entry.chart)) return entry;
  listed.add(entry.chart);
  (entry.chart.hooks.draw ??= []).push(dim);
  if (document.documentElement.dataset.mantineColorScheme === "light") relight(entry.chart);
  return entry;
};
let watched = null;
const watch = () => {
  const points = (window.__viserTestpoints ??= {});
  if (points.uplots && points.uplots === watched) return;
  const known = points.uplots ?? {};
  Object.values(known).forEach(enlist);
  points.uplots = watched = new Proxy(known, { set: (all, id, entry) => { all[id] = enlist(entry); return true; } });
};
watch();
// now and then uPlot does not lay out the time axis of a chart that is made with its data
setInterval(() => {
  watch();
  for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {}))
    if (!chart.axes[0]._splits) chart.setSize({ width: chart.width, height: chart.height });
}, 400);
