"""The style sheet and the one script of the page, injected as HTML.

uPlot now and then does not lay out the time axis of a chart that is made with its data; the script asks it again. It
also draws previews lighter: viser passes no function to uPlot, and no gap in a line. And it gives time axes the ends
that stand in their tab's marker, unless the user has zoomed in: new scales from the server would build a chart anew.

It tells the server which tabs of plots are on the screen (`looking.py`).

viser's text field sends every keystroke and knows no "Enter or leaving the field". The script tells the two apart:
it appends the character COMMIT to the text when the user is done, so a commit is an ordinary change of the value.
(A submit of viser's form would not do: the client has one throttled message slot, and a submit within 50 ms of the
last keystroke replaces that keystroke.)

Nor does viser's slider know "let go". The script notes which row's slider is held, by mouse, finger or arrow key, and
when it is let go appends RELEASED, or ESCAPED after the key, to the text of the same row: behind the slider's last
position, for which it waits, and in the same slot.
"""

from __future__ import annotations

from app.dashboard.theme import ACCENT, BOUND, DESIRED, MEASURED, css

# zero width: never typed, never seen
COMMIT, RELEASED, ESCAPED = MARKS = "\u200b", "\u200c", "\u200d"

_SCRIPT = """
if (!window.vsmrcCommit) {
  window.vsmrcCommit = true;
  const mark = "\\u200b";
  const field = (e) => e.target instanceof HTMLInputElement && e.target.type === "text" && e.target.closest("form")
    ? e.target : null;
  let writing = false;
  const write = (input, text) => {
    writing = true;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, text);
    input.dispatchEvent(new Event("input", { bubbles: true }));
    writing = false;
  };
  const commit = (input, text) => {
    if (input.dataset.pending === undefined) return;
    write(input, text + mark);
    delete input.dataset.pending;
  };
  document.addEventListener("input", (e) => {
    const input = field(e);
    if (input && !writing) input.dataset.pending = "";
  }, true);
  document.addEventListener("keydown", (e) => {
    const input = field(e);
    if (!input || (e.key !== "Enter" && e.key !== "Escape")) return;
    e.preventDefault();
    commit(input, e.key === "Enter" ? input.value : "");
    if (e.key === "Enter") input.select();
  }, true);
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
  const homes = new WeakMap(), near = (a, b) => Math.abs(a - b) < 1e-6 * (1 + Math.abs(b));
  const markOf = (node) => node && (node.querySelector(".vs-plots") ?? markOf(node.parentElement));
  const ends = (plot) => {
    const x = plot.data[0], mark = plot.scales.x.distr === 1 ? markOf(plot.root) : null;
    // over frequency with room beside the last one, at which chattering is
    return mark ? [Number(mark.dataset.from), Number(mark.dataset.to)] : [x[0], 1.2 * x[x.length - 1]];
  };
  const follow = (plot) => {
    const home = ends(plot), at = [plot.scales.x.min, plot.scales.x.max], x = plot.data[0];
    const is = (span) => !span || (near(at[0], span[0]) && near(at[1], span[1]));
    const free = is(homes.get(plot)) || is([x[0], x[x.length - 1]]);
    if (!(home[0] < home[1])) return;
    homes.set(plot, home);
    if (free && !is(home)) setTimeout(() => plot.setScale("x", { min: home[0], max: home[1] }));
  };
  const enlisted = new WeakSet();
  const enlist = (entry) => {
    const { chart } = entry;
    if (!enlisted.has(chart)) (chart.hooks.draw ??= []).push(dim, follow);
    // uPlot writes 0 for what is below 0.001
    if (chart.scales.y?.distr === 3) chart.axes[1].values = (_, at) => at.map((v) => (v === null ? "" : `${v}`));
    enlisted.add(chart);
    return entry;
  };
  let told = null;
  const report = () => {
    const input = document.querySelector("div:has(> .vs-looking) + div input");
    if (!input) return;
    const seen = document.hidden ? [] : [...document.querySelectorAll(".vs-plots")].filter(onScreen);
    const tabs = seen.map((mark) => mark.dataset.plots).join(",");
    if (told && told.input === input && told.tabs === tabs) return;
    told = { input, tabs };
    write(input, tabs + "#" + Math.random());
  };
  const onScreen = (mark) => {
    const { width, height } = mark.closest("[data-dock-group]")?.getBoundingClientRect() ?? { width: 99, height: 99 };
    return mark.checkVisibility() && width > 40 && height > 40;
  };
  document.addEventListener("visibilitychange", report);
  for (const kind of ["pointerup", "keyup"]) document.addEventListener(kind, () => setTimeout(report, 50), true);
  let watched = null;
  const watch = () => {
    const points = (window.__viserTestpoints ??= {});
    if (points.uplots && points.uplots === watched) return;
    const known = points.uplots ?? {};
    Object.values(known).forEach(enlist);
    points.uplots = watched = new Proxy(known, { set: (all, id, entry) => { all[id] = enlist(entry); return true; } });
  };
  watch();
  setInterval(() => {
    watch();
    report();
    for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {})) {
      if (!chart.axes[0]._splits) chart.setSize({ width: chart.width, height: chart.height });
      follow(chart);
    }
  }, 400);
  document.addEventListener("focusout", (e) => { const i = field(e); if (i) commit(i, i.value); }, true);

  let held = null, byKey = false;
  const slider = (e) => e.target instanceof Element ? e.target.closest("form .mantine-Slider-root") : null;
  const hold = (row, key) => { held = row; byKey = key; row.dataset.held = ""; row.vsmrcTurn = null; };
  const letGo = (mark) => {
    if (!held) return;
    const row = held, turn = (row.vsmrcTurn = {});
    held = null;
    // a frame and more than the 50 ms of the slot, so that the last position has gone; unless held again meanwhile
    requestAnimationFrame(() => setTimeout(() => {
      const input = row.querySelector("input.mantine-TextInput-input");
      if (row.vsmrcTurn !== turn || !input) return;
      write(input, input.value + mark);
      delete row.dataset.held;
    }, 80));
  };
  const moves = (e) => /^(Arrow|Home|End|Page)/.test(e.key);
  for (const kind of ["mousedown", "touchstart"])
    document.addEventListener(kind, (e) => { const s = slider(e); if (s) hold(s.closest("form"), false); }, true);
  for (const kind of ["mouseup", "touchend", "touchcancel"])
    document.addEventListener(kind, () => letGo("\\u200c"), true);
  document.addEventListener("keydown", (e) => {
    const s = slider(e);
    if (e.key === "Escape" && held) {
      letGo("\\u200d");
      document.dispatchEvent(new MouseEvent("mouseup", { bubbles: true }));
      document.dispatchEvent(new Event("touchend", { bubbles: true }));
    } else if (s && moves(e)) hold(s.closest("form"), true);
  }, true);
  document.addEventListener("keyup", (e) => { if (moves(e)) letGo("\\u200c"); }, true);
  // the keyup goes elsewhere then; a mouse stays with the page that it was pressed on
  window.addEventListener("blur", () => { if (byKey) letGo("\\u200c"); });
  // these step through the run: viser's camera, which listens at the document, would turn with them
  document.documentElement.addEventListener("keydown", (e) => {
    if (e.key === "ArrowLeft" || e.key === "ArrowRight") e.stopPropagation();
  });
  // an arrow that moves a slider is not the page's hotkey
  document.body.addEventListener("keydown", (e) => { if (slider(e) && moves(e)) e.stopPropagation(); });
}
"""

# A row of `controls.Number` is an unlabelled form of a text field and a slider: label | slider | text.
_CSS = f"""
form:has(.mantine-TextInput-root) {{
  display: grid; grid-template-columns: 7.6em 1fr 4.6em; align-items: center; gap: 0 0.5em;
  padding: 0 0.7em 0.3em 0.7em; min-height: 1.95em;
}}
form:has(.mantine-TextInput-root) > div, form:has(.mantine-TextInput-root) > div > div {{ display: contents; }}
form > div:has(.mantine-TextInput-root) > div > div:first-child {{ order: 1; width: auto !important; }}
form > div:has(.mantine-TextInput-root) > div > div:last-child {{ order: 3; grid-column: 3; }}
form:not(:has(.mantine-Slider-root)) > div > div > div:last-child {{ grid-column: 2 / 4 !important; }}
form > div:has(.mantine-Slider-root) > div > div:first-child {{ display: none; }}
form > div:has(.mantine-Slider-root) > div > div:last-child {{ order: 2; margin-top: -0.4em; }}
form .mantine-NumberInput-root, form .mantine-Slider-label {{ display: none; }}
/* the row after a note of this class: a text as wide as the panel allows */
div:has(> .vs-wide) + form {{ grid-template-columns: auto 1fr 0 !important; }}
form input {{ text-align: right !important; font-variant-numeric: tabular-nums; }}
div:has(> .vs-wide) + form input {{ text-align: left !important; font-family: monospace; }}
form input[data-pending] {{ border-color: {css(MEASURED)}; color: {css(MEASURED)}; }}
body:has(.vs-held) form[data-held] input {{ border-color: {css(MEASURED)}; color: {css(MEASURED)}; }}
form label {{ white-space: nowrap; }}
/* the status line stays in sight while the tabs scroll: nothing between it and the scroll area may clip */
div:has(> .vs-status) {{ position: sticky; top: 0; z-index: 5; background: var(--mantine-color-body); }}
div:has(> div > div > div > .vs-status) {{ overflow: visible !important; }}
.vs-status {{ padding: 0.5em 1.1em 0.35em 0.8em; font-size: 0.9em; line-height: 1.55;
  font-variant-numeric: tabular-nums; }}
.vs-row {{ display: flex; flex-wrap: wrap; gap: 0.35em 0.5em; align-items: center; }}
.vs-row > .vs-right {{ margin-left: auto; }}
.vs-title {{ font-weight: 600; font-size: 1.05em; }}
.vs-dim {{ opacity: 0.65; }}
.vs-number {{ display: inline-block; min-width: 3.6em; text-align: right; }}
.vs-chip {{ border-radius: 0.7em; padding: 0 0.7em; font-weight: 600; white-space: nowrap; }}
.vs-mode {{ background: {css(ACCENT, 0.25)}; color: #9cc3ff; }}
.vs-good {{ background: {css(DESIRED, 0.2)}; color: {css(DESIRED)}; }}
.vs-warn {{ background: {css(MEASURED, 0.2)}; color: {css(MEASURED)}; }}
.vs-bad {{ background: {css(BOUND, 0.25)}; color: #ff8f8f; }}
.vs-message {{ margin-top: 0.35em; padding: 0.2em 0.7em; border-left: 3px solid; border-radius: 0.2em;
  line-height: 1.35; overflow-wrap: anywhere; }}
.vs-verdict {{ padding: 0.3em 0.9em 0.4em; font-size: 0.88em; line-height: 1.5; }}
.vs-note {{ padding: 0.1em 0.8em 0.5em; font-size: 0.8em; line-height: 1.4; opacity: 0.75; }}
.vs-held {{ padding: 0.2em 0.8em 0.4em 0.8em; font-size: 0.9em; }}
.vs-held .vs-facts {{ width: 100%; margin: 0.3em 0 0.2em 0; font-size: 0.92em; }}
.vs-facts {{ width: calc(100% - 1.7em); margin: 0.2em 1em 0.6em 0.7em; font-size: 0.84em; border-collapse: collapse;
  font-variant-numeric: tabular-nums; }}
.vs-facts td {{ padding: 0.12em 0; border-bottom: 1px solid rgba(255, 255, 255, 0.07); }}
.vs-facts td:last-child {{ text-align: right; }}
.vs-runs th, .vs-runs td {{ text-align: right; padding-left: 0.5em !important; }}
.vs-runs td:first-child {{ text-align: left; padding-left: 0 !important; }}
.vs-bar {{ flex: 1; height: 0.7em; border-radius: 0.35em; }}
.vs-dot {{ display: inline-block; width: 0.7em; height: 0.7em; border-radius: 50%; }}
.vs-facts.vs-verdicts td:nth-child(2) {{ text-align: right; padding-right: 0.7em; }}
.vs-equation {{ padding: 0.2em 0.9em 0.6em; }}
.vs-equation math {{ font-size: 1.02em; overflow: auto; max-height: 45vh; max-width: 100%; }}
.vs-equation .fixed {{ opacity: 0.38; }}
.vs-equation .vs-block {{ font-size: 0.74em; border: solid; border-width: 0 1.5px; border-radius: 0.5em; }}
mtext.vs-where {{ white-space: nowrap; font-size: 0.8em; opacity: 0.75; padding-right: 0.4em; }}
.vs-about {{ position: relative; font-size: 0.85em; padding-bottom: 0.35em; outline: none; cursor: help; }}
.vs-help {{ border: 1px solid currentColor; border-radius: 50%; width: 1.35em; line-height: 1.25em; text-align: center;
  opacity: 0.7; }}
.vs-tip {{ display: none; flex-basis: 100%; line-height: 1.4; opacity: 0.85; }}
.vs-about:hover .vs-tip, .vs-about:focus .vs-tip {{ display: block; }}
.vs-checks {{ padding: 0.4em 0.8em 0 0.8em; font-size: 0.9em; }}
.vs-checks .vs-facts {{ width: 100%; margin: 0.2em 0; font-size: 0.92em; }}
.vs-checks .vs-facts td:not(:first-child) {{ text-align: right; }}
.vs-checks .vs-facts tr:first-child {{ opacity: 0.65; }}
.vs-poles {{ width: 100%; display: block; margin-top: 0.4em; }}
.vs-poles text {{ font-size: 10.5px; fill: currentColor; opacity: 0.7; stroke: none; }}
.vs-poles .left {{ fill: {css(DESIRED, 0.09)}; }}
.vs-poles .right {{ fill: {css(BOUND, 0.13)}; }}
.vs-poles .grid {{ stroke: currentColor; opacity: 0.22; fill: none; }}
.vs-poles .axis {{ stroke: currentColor; opacity: 0.5; }}
.vs-poles .now path {{ stroke: {css(ACCENT)}; stroke-width: 2.2; fill: none; }}
.vs-poles .asked circle {{ stroke: {css(MEASURED)}; stroke-width: 2; fill: none; }}
.vs-splash {{ padding: 1.2em 0.9em; font-size: 1.05em; }}
.vs-spinner {{ display: inline-block; width: 0.9em; height: 0.9em; margin-right: 0.6em; border-radius: 50%;
  border: 2px solid {css(ACCENT)}; border-top-color: transparent; animation: vs-turn 0.9s linear infinite; }}
@keyframes vs-turn {{ to {{ transform: rotate(360deg); }} }}
/* the field in which the script reports what is looked at */
div:has(> .vs-looking), div:has(> .vs-looking) + div {{ display: none; }}
.vs-plots {{ padding: 0 0.9em; font-size: 0.8em; }}
.vs-plots:not(:empty) {{ padding: 0.1em 0.9em 0; }}
/* two even rows of tabs, and what is chosen above plots side by side */
[data-dock-group]:has(.vs-plots) [data-dock-tab] {{ flex: 1 0 24%; padding: 0 !important; justify-content: center; }}
form:has(+ div > .vs-plots) {{ display: flex; gap: 0.4em; margin: -0.2em 0 -0.5em 0; }}
form:has(+ div > .vs-plots) > div {{ flex: 1 1 auto; padding-inline: 0.7em !important; }}
form:has(+ div > .vs-plots) > div:first-of-type:not(:last-of-type) {{ flex: 0 0 9.5em; }}
form:has(+ div > .vs-plots) .mantine-Flex-root > div:first-child {{ width: auto !important; }}
form:has(+ div > .vs-plots) input {{ text-align: left !important; }}
.vs-unlisted {{ display: none !important; }}
/* an enlarged plot is made with its data and out of the script's reach: another width has uPlot lay out its axes */
.mantine-Modal-body .uplot-container {{ animation: vs-settle 0.4s; }}
@keyframes vs-settle {{ from {{ width: 97%; }} }}
.u-title {{ font-size: 0.85em !important; font-weight: 600; }}
.u-legend {{ font-size: 0.72em !important; }}
.u-legend .u-value, .u-legend th::after {{ display: none !important; }}
"""

# Scripts in innerHTML do not run; the load event of an image that is part of the page does, and needs no request.
_PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


def injected_html() -> str:
    """The style sheet and the script, as an invisible piece of HTML."""
    script = _SCRIPT.replace("&", "&amp;").replace('"', "&quot;")
    return f'<style>{_CSS}</style><img src="{_PIXEL}" style="display:none" onload="{script}">'
