// Reading a plot: its values under the crosshair and now, two cursors with what lies between them, and the plot as large
// as there is room. viser's own enlargement is as low as the plot was.
const charts = () => Object.values(window.__viserTestpoints?.uplots ?? {}).map((entry) => entry.chart);
const values = document.createElement("div");
values.className = "vs-values";
values.hidden = true;
document.body.append(values);
// The legend has the values under the crosshair, and without one those of now, right of which lies what has not happened.
const short = (value) => (Number.isFinite(value) ? window.vsmrcNumber(value, 3) : "–");
// no finer than a plot can show: half a thousandth of its axis, in round numbers
const atFoot = ({ scales: { y } }, value) => y?.distr === 3 && value <= 1.0001 * y.min; // where zero stands, too
const onAxis = (plot, value) => {
  const { min, max, distr } = plot.scales.y ?? {};
  if (atFoot(plot, value)) return `≤ ${short(value)}`;
  if (distr === 3 || !(max > min)) return short(value);
  const step = 10 ** Math.floor(Math.log10((max - min) / 500));
  return short(+(Math.round(value / step) * step).toPrecision(12));
};
const now = (plot) => {
  if (plot.scales.x.distr !== 1) return null;
  const x = plot.data[0];
  let k = x.length - 1;
  while (k > 0 && x[k] > 1e-9) k--;
  return k;
};
const pointed = (plot) => plot.over.matches(":hover") || plot.cursor.left >= 0; // here, or in a plot that shares the crosshair
const inLegend = (plot) => {
  if (!plot.root.isConnected || pointed(plot)) return;
  const idx = now(plot);
  if (idx !== null) plot.setLegend({ idx }, false);
  else for (const none of plot.root.querySelectorAll(".u-legend .u-value")) none.textContent = "";
};
const listed = (series) => series.label && !/vs-unlisted/.test(series.class ?? "");
// A shading and the mark of an instant have an axis of their own, and no value.
const measurable = (series) => listed(series) && series.scale !== "backdrop";
// The values of line i by place: for a part of a stacked sum its own, not those of the edge of its area.
const valuesOf = (plot, i) => {
  const { data, series } = plot, { label } = series[i];
  const areas = plot.bands.map(({ series: ends }) => [data[Math.max(...ends)], data[Math.min(...ends)], series[Math.max(...ends)]])
    // a chart that is being updated may have bands of lines that it does not have yet
    .filter(([, , edge]) => label && edge?.label === label && !/vs-unlisted-edge-quantile/.test(edge.class ?? ""));
  return areas.length ? (k) => areas.reduce((sum, [edge, base]) => sum + edge[k] - base[k], 0) : (k) => data[i][k];
};
const valued = (plot) => {
  plot.series.forEach((series, i) => {
    series.value = (_, value, __, k) => {
      if (value === null || value === undefined) return "";
      if (!i) return pointed(plot) ? short(value) : "";
      return measurable(series) ? onAxis(plot, valuesOf(plot, i)(k)) : "";
    };
  });
  for (const entry of plot.root.querySelectorAll(".u-legend .u-series:not(:first-child) th"))
    entry.title = "click: hide or show it; with Ctrl: this one alone";
  (plot.hooks.draw ??= []).push(() => setTimeout(() => inLegend(plot)));
};

// Two cursors, at fractions of the time axis; the table has what lies between them, line by line.
const between = (plot, y, from, to) => {
  const x = plot.data[0], known = [...x.keys()].filter((k) => x[k] >= from && x[k] <= to && Number.isFinite(y(k)));
  if (known.length < 2) return null;
  const first = y(known[0]), last = y(known.at(-1)), step = last - first;
  const beyond = Math.max(0, ...known.map((k) => (y(k) - last) * Math.sign(step)));
  const outside = known.filter((k) => Math.abs(y(k) - last) > 0.02 * Math.abs(step)).at(-1) ?? known[0];
  const { min, max, distr } = plot.scales.y, largest = Math.max(...known.map((k) => Math.abs(y(k))));
  if (!(Math.abs(step) > (distr === 3 ? 1e-3 * largest : 0.01 * (max - min)))) return { step }; // nothing steps that one sees
  return { step, overshoot: (100 * beyond) / Math.abs(step), settling: x[Math.min(outside + 1, known.at(-1))] - x[known[0]] };
};
const unit = (value, name) => (Number.isFinite(value) ? `${short(value)} ${name}` : "–");
const fillTable = (plot, fractions, table) => {
  const { min, max } = plot.scales.x, [from, to] = [...fractions].sort((a, b) => a - b).map((s) => min + s * (max - min));
  const lines = plot.series.map((series, i) => [series, i]).slice(1)
    .filter(([series]) => series.show && measurable(series)).map(([series, i]) => [series, i, between(plot, valuesOf(plot, i), from, to)])
    .filter(([, , found]) => found).slice(0, 8); // a run that has nothing there is left out
  const measure = /\[[^\]]*\]\s*$/.exec(plot.root.querySelector(".u-title")?.textContent ?? "")?.[0].trim() ?? "";
  const rows = [["", `Δy ${measure}`.trim(), "overshoot", "settling, 2 %"], ...lines.map(([series, , found]) =>
    [series.label, plot.scales.y.distr === 3 ? short(found.step) : onAxis(plot, found.step), unit(Math.round(10 * found.overshoot) / 10, "%"), unit(found.settling, "s")])];
  table.replaceChildren(...[[`Δt = ${short(to - from)} s`], ...rows].map((cells, i) => {
    const line = document.createElement("tr");
    line.append(...cells.map((text, j) => {
      const cell = document.createElement(i < 2 || !j ? "th" : "td");
      cell.textContent = text;
      if (cells.length === 1) cell.colSpan = 4;
      return cell;
    }));
    return line;
  }));
};
const STRIDE = 0.01; // of the time axis, by an arrow key; a tenth of it with Shift
const measured = new Map(); // what a plot's cursors are made of
const put = (plot) => {
  const fractions = [0.3, 0.7], table = document.createElement("table");
  table.className = "vs-measured";
  const show = () => {
    const { min, max } = plot.scales.x;
    cursors.forEach((cursor, i) => {
      const t = +(min + fractions[i] * (max - min)).toPrecision(3);
      cursor.style.left = `${100 * fractions[i]}%`;
      Object.assign(cursor, { ariaValueMin: min, ariaValueMax: max, ariaValueNow: t, ariaValueText: `${short(t)} s` });
    });
    fillTable(plot, fractions, table);
  };
  const cursors = fractions.map((_, i) => {
    const cursor = document.createElement("div");
    Object.assign(cursor, { className: "vs-cursor", tabIndex: 0, role: "slider", ariaLabel: `cursor ${"AB"[i]}` });
    cursor.dataset.name = "AB"[i];
    const place = (fraction) => {
      fractions[i] = Math.min(1, Math.max(0, fraction));
      show();
    };
    for (const kind of ["mousedown", "click", "dblclick"]) cursor.addEventListener(kind, (e) => e.stopPropagation());
    cursor.addEventListener("pointerdown", (e) => cursor.setPointerCapture(e.pointerId));
    cursor.addEventListener("pointermove", (e) => {
      const box = plot.over.getBoundingClientRect();
      if (cursor.hasPointerCapture(e.pointerId)) place((e.clientX - box.left) / box.width);
    });
    cursor.addEventListener("keydown", (e) => {
      if (e.key !== "ArrowLeft" && e.key !== "ArrowRight") return;
      e.preventDefault();
      e.stopPropagation(); // a command of the page, too
      place(fractions[i] + (e.key === "ArrowRight" ? STRIDE : -STRIDE) * (e.shiftKey ? 0.1 : 1));
    });
    return cursor;
  });
  show();
  plot.over.append(...cursors);
  plot.root.append(table);
  measured.set(plot, { parts: [...cursors, table], box: plot.root.closest(".uplot-container"), again: show });
};
const takeOff = (plot) => {
  for (const part of measured.get(plot)?.parts ?? []) part.remove();
  measured.delete(plot);
};
const row = (name, text, color) => {
  const line = document.createElement("div"), number = document.createElement("b");
  line.append(`${name} `, number);
  number.textContent = text;
  line.style.color = color;
  return line;
};
// uPlot draws the point of a line that is not there at its plot's corner.
const hidePointsOfNothing = (plot) => {
  const { idx } = plot.cursor;
  plot.root.querySelectorAll(".u-cursor-pt").forEach((point, i) => {
    point.style.visibility = idx == null || Number.isFinite(plot.data[i + 1]?.[idx]) ? "" : "hidden";
  });
};
const showValues = (plot) => {
  const { idx, left, top } = plot.cursor, hovered = plot.over.matches(":hover");
  if (!hovered && values.vsmrcPlot !== plot) return;
  values.hidden = !hovered || idx == null || left < 0;
  if (values.hidden) return;
  values.vsmrcPlot = plot;
  const lines = plot.series.slice(1).map((series, i) => [series, valuesOf(plot, i + 1)(idx), series.stroke?.(plot, i + 1)])
    .filter(([series, value]) => series.show && measurable(series) && Number.isFinite(value))
    .map(([series, value, color]) => row(series.label, `${atFoot(plot, value) ? "≤ " : ""}${window.vsmrcNumber(value, 4)}`, color));
  values.replaceChildren(row(plot.series[0].label, window.vsmrcNumber(plot.data[0][idx], 4), ""), ...lines);
  const over = plot.over.getBoundingClientRect(), { width, height } = values.getBoundingClientRect();
  const x = over.left + left + 14, y = over.top + top + 14;
  values.style.left = `${x + width < innerWidth ? x : x - width - 28}px`;
  values.style.top = `${Math.max(4, Math.min(y, innerHeight - height - 4))}px`;
};

// The size of a plot's own letters, as a factor. uPlot derives them from the last entry, in px of the page, when the
// browser's zoom changes.
const types = new WeakMap();
window.vsmrcType = (plot, factor) => {
  const own = types.get(plot) ?? plot.axes.map(({ font, size, space, gap }) => ({ letters: font[2], size, space, gap }));
  types.set(plot, own);
  plot.axes.forEach((axis, i) => {
    const { letters, size, space, gap } = own[i], px = factor * letters * devicePixelRatio;
    axis.font = [axis.font[0].replace(/[\d.]+px/, `${px}px`), px, factor * letters];
    axis.gap = factor * gap;
    axis.size = (...args) => factor * size(...args);
    axis.space = (...args) => (i === 1 ? factor * factor : factor) * space(...args); // fewer numbers than room for
  });
  for (const series of plot.series) series.width *= factor / (plot.vsmrcFactor ?? 1);
  plot.vsmrcFactor = factor;
};

const LARGE = 1.8; // of an enlarged plot
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
  if (plot) {
    takeOff(plot);
    window.vsmrcType(plot, 1);
  }
  plot?.setSize({ width: plot.width, height });
};
const grow = (box) => {
  const plot = chartIn(box);
  if (!plot) return;
  box.dataset.large = plot.height;
  window.vsmrcType(plot, LARGE);
  fit(plot);
};
document.addEventListener("click", (e) => {
  const box = e.target instanceof Element && e.target.closest(".uplot-container"), button = box && e.target.closest("button");
  if (button?.matches(".vs-unzoom")) {
    e.stopPropagation();
    window.vsmrcWhole();
    return;
  }
  const again = box === large(), measures = button?.matches(".vs-measure");
  if (!button) return; // what else is pressed leaves it large, with its cursors
  if (measures) {
    e.stopPropagation();
    const plot = chartIn(box);
    if (measured.has(plot)) takeOff(plot);
    else {
      if (!again) { shrink(); grow(box); }
      put(plot);
    }
    return;
  }
  e.stopPropagation();
  shrink();
  if (!again) grow(box);
}, true);
document.addEventListener("keydown", (e) => {
  if (e.key !== "Escape" || e.defaultPrevented || !large()) return;
  shrink();
  e.preventDefault(); // one Esc ends one thing (stage.js)
}, true);

const read = new WeakSet();
setInterval(() => {
  for (const plot of charts().filter((plot) => !read.has(plot))) {
    read.add(plot);
    (plot.hooks.setCursor ??= []).push(hidePointsOfNothing, showValues);
    (plot.hooks.setSize ??= []).push(fit);
    valued(plot);
    setTimeout(() => inLegend(plot)); // a run that stands still is not drawn again
    const box = plot.root.closest(".uplot-container");
    if (!box || box.querySelector(".vs-enlarge")) continue;
    // viser's own button to enlarge a plot is there only under the mouse: this one is for the keyboard
    const enlarge = document.createElement("button");
    Object.assign(enlarge, { className: "vs-enlarge", title: "enlarge" });
    enlarge.setAttribute("aria-label", "enlarge the plot, or make it small again");
    enlarge.innerHTML = '<svg viewBox="0 0 16 16" aria-hidden="true"><path d="M9 2h5v5M14 2l-5 5M7 14H2V9M2 14l5-5"/></svg>';
    box.append(enlarge);
    if (plot.scales.x.distr !== 1) continue;
    const button = document.createElement("button");
    Object.assign(button, { className: "vs-measure", textContent: "Δ", title: "two cursors: Δt, Δy, overshoot, settling" });
    button.setAttribute("aria-label", "measure with two cursors");
    const whole = document.createElement("button");
    Object.assign(whole, { className: "vs-unzoom", textContent: "whole window", title: "the whole window again, in all plots" });
    enlarge.before(button, whole);
  }
  for (const [plot, { box, again }] of [...measured]) {
    if (plot.root.isConnected) again();
    else { // viser has built it anew, or will
      const anew = box?.isConnected && chartIn(box);
      if (anew || !box?.isConnected) measured.delete(plot);
      if (anew) put(anew);
    }
  }
  const enlarged = large() && chartIn(large());
  if (enlarged) {
    if (enlarged.vsmrcFactor !== LARGE) window.vsmrcType(enlarged, LARGE);
    fit(enlarged); // a message above it takes room
  }
  if (values.vsmrcPlot && !values.vsmrcPlot.root.isConnected) values.hidden = true;
}, 300);

// A table goes to the clipboard with tabs between its cells, as spreadsheets read it. They would evaluate the name of a
// run that begins like a formula.
const cellText = (cell) => {
  const text = cell.innerText.trim().replace(/\s+/g, " ");
  return /^[=@+-]/.test(text) && !/^[+-]?[\d.]/.test(text) ? `'${text}` : text;
};
const tell = (button, text) => { // for a while: the table changes
  button.dataset.says ??= button.textContent;
  button.textContent = text;
  setTimeout(() => { button.textContent = button.dataset.says; }, 2000);
};
document.addEventListener("click", async (e) => {
  const button = e.target instanceof Element && e.target.closest("[data-copy]");
  const table = button && document.querySelector(button.dataset.copy);
  if (!table) return;
  const text = [...table.rows].map((line) => [...line.cells].map(cellText).join("\t")).join("\n");
  try {
    await navigator.clipboard.writeText(text);
    tell(button, "Copied");
  } catch { // only pages by https or of this machine may write there
    const field = Object.assign(document.createElement("textarea"), { value: text });
    document.body.append(field);
    field.select();
    const copied = document.execCommand("copy");
    field.remove();
    if (!copied) getSelection().selectAllChildren(table);
    tell(button, copied ? "Copied" : "Selected: press Ctrl+C");
  }
});
