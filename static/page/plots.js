// What viser hands no option for: the preview is drawn lighter, time axes have the ends that stand in their tab's marker
// unless the user has zoomed in, and every line is dark enough for a light page.
// right of zero lies what has not happened: less of it
const dim = (plot) => {
  if (plot.scales.x.distr !== 1) return;
  const { left, top, width, height } = plot.bbox, from = Math.max(plot.valToPos(0, "x", true), left);
  if (!(from < left + width - 1)) return;
  plot.ctx.save();
  plot.ctx.globalCompositeOperation = "destination-out";
  plot.ctx.fillStyle = "rgba(0, 0, 0, 0.5)";
  plot.ctx.fillRect(from + 1, top, left + width - from, height);
  plot.ctx.restore();
};
// new scales from the server would build a chart anew
const homes = new WeakMap(), near = (a, b) => Math.abs(a - b) < 1e-6 * (1 + Math.abs(b));
const markOf = (node) => node && (node.querySelector(".vs-plots") ?? markOf(node.parentElement));
const ends = (plot) => {
  const x = plot.data[0], mark = plot.scales.x.distr === 1 ? markOf(plot.root) : null;
  // over frequency with room beside the last one, at which chattering is
  return mark ? [Number(mark.dataset.from), Number(mark.dataset.to)] : [x[0], 1.2 * x[x.length - 1]];
};
const stands = (plot) => plot.root.isConnected && plot.data?.[0]?.length; // neither being built nor taken down
const follow = (plot) => {
  if (!stands(plot)) return;
  const home = ends(plot), at = [plot.scales.x.min, plot.scales.x.max], x = plot.data[0];
  const is = (span) => !span || (near(at[0], span[0]) && near(at[1], span[1]));
  const free = is(homes.get(plot)) || is([x[0], x[x.length - 1]]);
  if (!(home[0] < home[1])) return;
  homes.set(plot, home);
  plot.root.closest(".uplot-container")?.toggleAttribute("data-zoomed", !free && !is(home));
  if (free && !is(home)) setTimeout(() => { if (stands(plot)) plot.setScale("x", { min: home[0], max: home[1] }); });
};
// All time axes are zoomed into at once, by the crosshair that they share, and out again, too.
window.vsmrcWhole = () => {
  for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {}))
    if (stands(chart) && chart.scales.x.distr === 1 && homes.has(chart)) {
      const [min, max] = homes.get(chart);
      chart.setScale("x", { min, max });
    }
};
document.addEventListener("dblclick", (e) => { if (e.target instanceof Element && e.target.closest(".u-over")) window.vsmrcWhole(); });
// 3:1 on white is a relative luminance of 0.3 at most. The lightest colours become the darkest, so that yellow and
// orange stay apart. viser makes every chart anew when the theme changes.
const pen = document.createElement("canvas").getContext("2d");
const onWhite = (color) => {
  if (typeof color !== "string") return color;
  pen.fillStyle = color; // "#rrggbb" or "rgba(r, g, b, a)" is what it reads back
  const hex = /^#(..)(..)(..)$/.exec(pen.fillStyle), found = hex ?? /(\d+), (\d+), (\d+), ([\d.]+)/.exec(pen.fillStyle);
  const light = found.slice(1, 4).map((c) => Math.pow((hex ? parseInt(c, 16) : +c) / 255, 2.2));
  const luminance = 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2];
  const factor = luminance <= 0.28 ? 1 : (0.28 - 0.35 * (luminance - 0.28)) / luminance;
  const [r, g, b] = light.map((c) => Math.round(255 * Math.pow(factor * c, 1 / 2.2)));
  return `rgba(${r}, ${g}, ${b}, ${hex ? 1 : found[4]})`;
};
const relight = (chart) => {
  for (const series of chart.series) {
    const own = series.stroke;
    if (typeof own === "function") series.stroke = (...args) => onWhite(own(...args));
  }
  for (const marker of chart.root.querySelectorAll(".u-legend .u-marker"))
    marker.style.borderColor = onWhite(marker.style.borderColor);
};
// A number as text. From a million on with a power of ten, since neither a legend nor an axis has room for more digits.
const LONG = 1e6, RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const FINEST = 1e-6; // least span of an axis, as a share of its largest number (at least 1): less is rounding
const signed = (text) => text.replace("-", "−"); // scripts write a hyphen
const power = (mantissa, exponent) => signed(`${mantissa === 1 ? "" : `${mantissa}·`}`) + `10${[...`${exponent}`].map((digit) => RAISED[digit] ?? "⁻").join("")}`;
const plain = (value) => { // scripts write 1e-7, too
  const [mantissa, exponent] = `${value}`.split("e");
  return exponent ? power(+mantissa, +exponent) : signed(mantissa);
};
window.vsmrcNumber = (value, digits) => {
  const short = +value.toPrecision(digits), [mantissa, exponent] = short.toExponential().split("e");
  return Math.abs(short) >= LONG ? power(+mantissa, +exponent) : plain(short);
};
// Three numbers on an axis at least, also of a low plot, as far as they stand apart.
const room = (plot) => (1.05 * plot.axes[1].font[1]) / devicePixelRatio; // px
const STEPS = [1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10];
const three = (splits) => (plot, i, min, max, incr, space, ...args) => {
  const at = splits(plot, i, min, max, incr, space, ...args);
  if (at.length > 2) return at;
  const least = (room(plot) * incr) / space, ten = 10 ** Math.floor(Math.log10(least)), step = ten * STEPS.find((each) => each * ten >= least);
  const first = Math.ceil(min / step - 1e-9), more = Array.from({ length: Math.floor(max / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
  return more.length > at.length ? more : at;
};
// On a logarithmic one of many decades every so many, of few also threes, or twos and fives, and where none of these are
// three, the roundest. Of less than a decade, as from 8 to 20, also what lies between two neighbours.
const AIRY = 1.2; // times the room that a number needs at least
const NEAT = [/^[13]e/, /^[125]e/, /^[12357]e/], ROUND = [/^1e/, /^5e/, /^2e/, /^3e/, /^.e/, /./];
const halved = (splits) => (...args) => {
  const at = splits(...args), few = at.length === 2, short = at.at(-1) < 4 * at[0];
  return at.flatMap((v, i) => (few || (short && at[i + 1] > 1.25 * v) ? [v, (v + at[i + 1]) / 2] : [v])).filter(Number.isFinite);
};
const decades = (plot, at) => {
  const digits = new Map(at.map((v) => [v, (+v.toPrecision(9)).toExponential()])), place = new Map(at.map((v) => [v, plot.valToPos(v, "y")]));
  const free = (v, others) => others.every((other) => Math.abs(place.get(v) - place.get(other)) >= room(plot));
  const begun = (first) => at.filter((v) => first.test(digits.get(v)));
  const decade = Math.abs(plot.valToPos(10, "y") - plot.valToPos(1, "y")) / room(plot);
  const everyFew = (least) => begun(ROUND[0]).filter((v) => Math.round(Math.log10(v)) % Math.max(1, Math.ceil(least / decade)) === 0);
  const neat = [everyFew(AIRY), everyFew(1), ...NEAT.map(begun)];
  const apart = neat.find((some) => some.length > 2 && some.every((v, i) => free(v, some.slice(0, i))));
  const shown = apart ?? ROUND.flatMap(begun).reduce((some, v) => (free(v, some) ? [...some, v] : some), []);
  const long = shown.some((v) => v >= LONG), exponent = (v) => Math.floor(Math.log10(v) + 1e-9); // one form for all of an axis
  const text = (v) => (long && v >= 1 ? power(+(v / 10 ** exponent(v)).toPrecision(9), exponent(v)) : plain(+v.toPrecision(9)));
  return at.map((v) => (shown.includes(v) ? text(v) : ""));
};
// uPlot knows null for what does not exist, and data arrive as numbers. A gap begins at the last value before it: a
// logarithmic axis would draw nan as a fall to its foot.
const gaps = (plot, number, from, to, found) => {
  const x = plot.data[0], y = plot.data[number], at = (k) => Math.round(plot.valToPos(x[k], "x", true));
  for (let k = from; k <= to; k++) {
    if (!Number.isNaN(y[k])) continue;
    const before = Math.max(from, k - 1);
    while (k < to && Number.isNaN(y[k + 1])) k++;
    found.push([at(before) - 2, at(Math.min(to, k + 1)) + 2]); // the line's width
  }
  return found;
};
// Where a line begins with what does not exist, uPlot finds no least and no largest value, and draws nothing.
const extremes = (plot) => {
  const [from, to] = plot.series[0].idxs ?? [0, plot.data[0].length - 1];
  const known = plot.series.flatMap(({ show, scale }, i) =>
    i && show && scale === "y" ? Array.from(plot.data[i].slice(from, to + 1)).filter(Number.isFinite) : []);
  return known.length ? [Math.min(...known), Math.max(...known)] : [null, null];
};
const ranged = (scale) => {
  const own = scale?.range;
  if (typeof own !== "function") return;
  scale.range = (plot, least, most, key) => {
    const [low, high] = Number.isNaN(least) || Number.isNaN(most) ? extremes(plot) : [least, most];
    // without any line uPlot leaves out the whole axis, and the first number of the other one is cut
    if (low === null) return [scale.distr === 3 ? 0.01 : 0, 1];
    const [from, to] = own(plot, low, high, key), lack = FINEST * Math.max(1, Math.abs(from), Math.abs(to)) - (to - from);
    return scale.distr === 1 && lack > 0 ? [from - lack / 2, to + lack / 2] : [from, to]; // rounding does not fill a plot
  };
};
const stepless = ({ axes, root }) => root.offsetParent && axes[0]._found?.[1] === 0;
const crowded = ({ axes, scales: { x, y }, bbox }) => [[axes[0], x, bbox.width, 30], [axes[1], y, bbox.height, 10]].some(
  ([axis, scale, room, least]) => {
    const [first, next] = axis._splits ?? [];
    return scale?.distr === 1 && ((next - first) / (scale.max - scale.min)) * room < least * devicePixelRatio;
  });
// The numbers of an axis with as many decimals as its steps have. uPlot rounds to three: it writes 0 for what is below
// 0.001, and neighbours far from zero look alike.
const written = (at) => {
  const most = Math.max(...at.map(Math.abs)), exponent = most >= LONG ? Math.floor(Math.log10(most)) : 0, unit = 10 ** exponent;
  const scaled = at.map((v) => v / unit), step = at.length > 1 ? scaled[1] - scaled[0] : 0.001;
  let digits = 0;
  while (digits < 8 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6 * step * 10 ** digits) digits++;
  return scaled.map((v) => (exponent && v ? power(+v.toFixed(digits), exponent) : plain(+v.toFixed(digits))));
};
// In the legend a pinned run has a piece of its line, and hides all its lines, which come behind the one that is listed.
// A line of the shown run hides the same line of pinned runs with it, unless one of these stands alone, and the edges of
// its areas and of its band.
const ofRun = (series) => /vs-run/.test(series?.class ?? ""), unlisted = (series) => /vs-unlisted/.test(series?.class ?? "");
const edge = (series) => /vs-unlisted-edge/.test(series?.class ?? "");
const piece = (marker, dash) => {
  let at = 0;
  const parts = dash.map((length, i) => `${i % 2 ? "transparent" : marker.style.borderColor} ${at}px ${(at += length)}px`);
  marker.style.backgroundImage = `repeating-linear-gradient(90deg, ${parts.join(", ")})`;
};
const together = (plot) => queueMicrotask(() => {
  const lines = plot.series.filter((series) => series.label && !unlisted(series) && !ofRun(series)).slice(1); // without the time
  const hidden = lines.some(({ show }) => show) ? lines.filter(({ show }) => !show).map(({ label }) => label) : [];
  let run = null;
  plot.series.forEach((series, i) => {
    if (!unlisted(series)) run = ofRun(series) ? series : null;
    else {
      const whole = edge(series) ? (lines.find(({ label }) => label === series.label)?.show ?? true) : !run || (run.show && !hidden.includes(series.label));
      if (series.show !== whole) plot.setSeries(i, { show: whole });
    }
  });
});
// Ctrl leaves one entry of the legend, and then all again: a pinned run, or a line of the shown run and of pinned runs.
const isolate = (plot) => (e) => {
  const row = (e.ctrlKey || e.metaKey) && e.target instanceof Element ? e.target.closest(".u-series") : null;
  const chosen = [...plot.root.querySelectorAll(".u-legend .u-series")].indexOf(row);
  if (chosen < 1) return;
  e.stopPropagation();
  const entryOfLines = (i) => ofRun(plot.series[i]) && unlisted(plot.series[i + 1]);
  const stays = (i) => i === chosen || (entryOfLines(i) && !ofRun(plot.series[chosen]));
  const alone = plot.series.every((series, i) => i === 0 || !series.show || unlisted(series) || stays(i));
  plot.batch(() => plot.series.forEach((_, i) => { if (i > 0) plot.setSeries(i, { show: alone || stays(i) }); }));
};
const listed = new WeakSet();
const enlist = (entry) => {
  const { chart } = entry;
  if (listed.has(chart)) return entry;
  listed.add(chart);
  (chart.hooks.draw ??= []).push(dim, follow);
  (chart.hooks.setSeries ??= []).push(together);
  chart.root.querySelector(".u-legend")?.addEventListener("click", isolate(chart), true);
  for (const series of chart.series) series.gaps = gaps;
  ranged(chart.scales.y);
  chart.axes[0].space = () => 40; // px: three numbers in a narrow dock, too
  const { values } = chart.axes[0];
  chart.axes[0].values = (...args) => values(...args).map((text) => text && signed(text));
  const axis = chart.axes[1];
  if (chart.scales.y?.distr === 3) {
    Object.assign(axis, { values: decades, splits: halved(axis.splits), filter: (_, at) => at });
    axis.grid.filter = (_, at) => at.map((v) => (/^1e/.test((+v.toPrecision(9)).toExponential()) ? v : null)); // decades
  }
  else Object.assign(axis, { values: (_, at) => written(at), splits: three(axis.splits) });
  if (document.documentElement.dataset.mantineColorScheme === "light") relight(chart);
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
// A plot that is wider than its dock, as when the window becomes narrow while it is built, would stay so, and the dock
// would scroll sideways: viser sets its width only when that of its place changes.
const SIDES = 20; // px, beside a plot
const refit = (chart) => {
  const room = chart.root.closest(".mantine-ScrollArea-viewport")?.clientWidth;
  if (room > SIDES && chart.width > room && !chart.root.closest("[data-large]")) chart.setSize({ width: room - SIDES, height: chart.height });
};
// On a phone one plot is in sight at a time, as high as it can be read; the server shares the scene's height among all.
const HIGH = 230; // px, with the numbers of the time axis
const phone = matchMedia("(max-width: 36em)");
const heighten = (chart) => {
  if (phone.matches && chart.height < HIGH && !chart.root.closest("[data-held-plot], [data-large]"))
    chart.setSize({ width: chart.width, height: HIGH });
};
setInterval(() => {
  watch();
  for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {})) {
    // now and then uPlot does not lay out the time axis of a chart that is made with its data, or keeps the numbers of a
    // size that it no longer has; of a chart that was hidden when its size changed it has found no step of the numbers
    if (stands(chart) && (!chart.axes[0]._splits || stepless(chart) || crowded(chart))) chart.setSize({ width: chart.width, height: chart.height });
    if (stands(chart)) { refit(chart); heighten(chart); }
    follow(chart);
    const markers = chart.root.querySelectorAll(".u-legend .u-marker");
    chart.series.forEach((series, i) => {
      const { dash, width, fill } = series;
      markers[i]?.toggleAttribute("data-dashed", !!dash && !ofRun(series)); // as its line
      markers[i]?.toggleAttribute("data-shading", !!fill && !width);
      if (markers[i] && ofRun(series)) piece(markers[i], dash);
    });
  }
}, 400);
