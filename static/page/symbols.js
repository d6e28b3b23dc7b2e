// Every symbol explains itself where it stands: in the equation, in titles and legends of plots, in tables and in labels.
// The glossary is a template of the server (widgets/theorem/symbols.py); here it becomes a tip, a page, and letters with
// indices.
const template = () => document.querySelector("template#vs-symbols");
let entries = [], parsed = null;
const symbolsByText = new Map(); // names that have been looked for in a text
const known = () => {
  if (template() && parsed !== template()) {
    parsed = template();
    symbolsByText.clear();
    entries = [...parsed.content.querySelectorAll("[data-of]")].map((entry) => ({ entry, of: entry.dataset.of, names: entry.dataset.names.split("|") }));
  }
  return entries;
};
// Names in a text, the longest first, each letter once; what stands in brackets is a unit.
const LETTER = /[\p{L}\p{Nd}_′]/u; // an index below the line is none: τ₁ is a τ
const found = (text) => {
  known();
  if (symbolsByText.size > 1000) symbolsByText.clear(); // cells have numbers that change
  if (!symbolsByText.has(text)) symbolsByText.set(text, search(text));
  return symbolsByText.get(text);
};
const search = (text) => {
  let rest = text.normalize("NFC").replace(/\[[^\]]*\]/g, (unit) => " ".repeat(unit.length));
  const all = known().flatMap(({ of, names }) => names.map((name) => [name.normalize("NFC"), of]));
  const at = [];
  for (const [name, of] of all.sort((a, b) => b[0].length - a[0].length))
    for (let i = rest.indexOf(name); i >= 0; i = rest.indexOf(name, i + 1)) {
      const before = rest[i - 1] ?? " ", after = rest[i + name.length] ?? " ";
      if ((LETTER.test(before) && LETTER.test(name[0])) || (LETTER.test(after) && LETTER.test(name.at(-1)))) continue;
      at.push([i, of]);
      rest = rest.slice(0, i) + "\u0000".repeat(name.length) + rest.slice(i + name.length);
    }
  return [...new Set(at.sort((a, b) => a[0] - b[0]).map(([, of]) => of))].slice(0, 3);
};
const PLACES = ".u-legend .u-series th, .u-title, .vs-facts td:first-child, .vs-where, label, .vs-set";
const place = (target) => (target instanceof Element ? target.closest(`[data-symbol], ${PLACES}`) : null);
const symbolsOf = (where) => (where.dataset?.symbol ? [where.dataset.symbol] : found(where.textContent));

// Letters with their indices: the underscore stays in the text, unseen, for whoever copies or hears it.
const TEXTS = "[role=tab] span, .u-title, .u-legend th > .u-label, .vs-note, .vs-tip, .vs-checks, .vs-held, .vs-message, .vs-undo, .vs-facts td:first-child";
const INDEXED = /(?<![\p{L}\p{N}_./])(\p{L}\p{M}?)_([A-Za-z0-9]{1,3})(?![\p{Lu}\p{Ll}\p{N}_])/gu;
const typeset = (root) => {
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT), texts = [];
  while (walker.nextNode())
    if (walker.currentNode.data.includes("_") && !walker.currentNode.parentElement.closest(".vs-index, input, textarea, code")) texts.push(walker.currentNode);
  for (const text of texts) {
    const parts = [];
    let from = 0;
    for (const hit of text.data.normalize("NFC").matchAll(INDEXED)) {
      const letter = document.createElement("i"), line = document.createElement("span"), index = document.createElement("sub");
      [letter.textContent, line.textContent, index.textContent] = [hit[1], "_", hit[2]];
      line.className = "vs-index";
      parts.push(text.data.normalize("NFC").slice(from, hit.index), letter, line, index);
      from = hit.index + hit[0].length;
    }
    if (parts.length) text.replaceWith(...parts, text.data.normalize("NFC").slice(from));
  }
};
// at once, before it is painted: what a held slider does is sent again many times a second
new MutationObserver((changes) => {
  const roots = new Set();
  for (const { target, addedNodes } of changes) {
    const within = (target instanceof Element ? target : target.parentElement)?.closest(TEXTS);
    if (within) roots.add(within);
    else for (const node of addedNodes) if (node instanceof Element)
      for (const root of [node, ...node.querySelectorAll(TEXTS)]) if (root.matches(TEXTS)) roots.add(root);
  }
  for (const root of roots) typeset(root);
}).observe(document.body, { childList: true, characterData: true, subtree: true });
for (const root of document.querySelectorAll(TEXTS)) typeset(root);

// viser's labels are kept by its own program: beside each stands one that is set, and the label itself is only heard
const setLabels = () => {
  for (const label of document.querySelectorAll("label")) {
    const text = label.textContent, beside = label.nextElementSibling?.matches(".vs-set") ? label.nextElementSibling : null;
    if (beside?.dataset.of === text) continue;
    beside?.remove();
    const has = new RegExp(INDEXED, "u").test(text.normalize("NFC"));
    label.toggleAttribute("data-set", has);
    if (!has) continue;
    const set = document.createElement("span"), { fontSize, fontWeight, letterSpacing, lineHeight } = getComputedStyle(label);
    Object.assign(set, { className: "vs-set", textContent: text });
    Object.assign(set.style, { fontSize, fontWeight, letterSpacing, lineHeight });
    Object.assign(set.dataset, { of: text });
    set.setAttribute("aria-hidden", "true");
    set.addEventListener("click", () => label.control?.focus());
    typeset(set);
    label.after(set);
  }
};

const tip = document.createElement("div");
Object.assign(tip, { className: "vs-symbol", id: "vs-symbol", hidden: true });
tip.setAttribute("role", "tooltip");
document.body.append(tip);
let shown = null; // { where, symbols, by, x, y }
const present = () => {
  try { return JSON.parse(document.querySelector("data#vs-values")?.value || "{}"); } catch { return {}; }
};
const write = () => {
  const values = present(), list = document.createElement("dl"); // terms stand in a list, for those who hear it
  list.append(...shown.symbols.map((of) => {
    const entry = known().find((each) => each.of === of).entry.cloneNode(true);
    typeset(entry);
    if (values[of]) {
      const now = document.createElement("dd");
      now.className = "vs-present";
      now.textContent = `now ${values[of]}`;
      entry.append(now);
    }
    return entry;
  }));
  tip.replaceChildren(list);
};
const put = () => {
  const box = shown.where.getBoundingClientRect(), { width, height } = tip.getBoundingClientRect();
  const under = box.bottom + 6 + height < innerHeight ? box.bottom + 6 : box.top - height - 6;
  tip.style.left = `${Math.max(6, Math.min(box.left, innerWidth - width - 6))}px`;
  tip.style.top = `${Math.max(6, under)}px`;
};
// the lines of the symbol stay, the others step back; a plot that is named after it has a frame
const charts = () => Object.values(window.__viserTestpoints?.uplots ?? {}).map((entry) => entry.chart);
const highlight = (symbols) => {
  for (const plot of charts().filter((each) => each.root.isConnected)) {
    const own = plot.series.map((series, i) => i > 0 && found(series.label ?? "").some((of) => symbols.includes(of)));
    const any = own.some(Boolean), title = plot.root.querySelector(".u-title")?.textContent ?? "";
    plot.root.classList.toggle("vs-named", symbols.length > 0 && (any || found(title).some((of) => symbols.includes(of))));
    plot.series.forEach((series, i) => { if (i) series.alpha = any && !own[i] ? 0.15 : 1; });
    plot.redraw(false);
  }
};
const show = (where, by) => {
  const symbols = symbolsOf(where);
  if (!symbols.length || !known().length) return hide();
  if (shown?.where === where) return;
  shown?.where.removeAttribute("aria-describedby");
  shown = { where, symbols, by };
  where.setAttribute("aria-describedby", tip.id);
  tip.hidden = false;
  write();
  put();
  highlight(symbols);
};
const hide = () => {
  if (!shown) return;
  shown.where.removeAttribute("aria-describedby");
  shown = null;
  tip.hidden = true;
  highlight([]);
};
let waiting = 0, awaited = "", pointer = [0, 0], keyed = false;
const same = (where) => (where ? symbolsOf(where).join() : "");
// what stands there then: tables are sent again and again
const later = (where) => {
  if (same(where) === awaited) return;
  clearTimeout(waiting);
  awaited = same(where);
  waiting = setTimeout(() => {
    const now = place(document.elementFromPoint(...pointer));
    if (now && same(now) === awaited) show(now, "mouse");
    awaited = "";
  }, 250);
};
document.addEventListener("pointermove", (e) => { pointer = [e.clientX, e.clientY]; }, true);
document.addEventListener("pointerover", (e) => {
  const where = place(e.target);
  if (e.pointerType !== "mouse" || e.buttons) return;
  if (shown && where && same(where) === shown.symbols.join()) shown.where = where;
  else if (where && where.tagName !== "LABEL") later(where); // viser has a hint for its labels
  else {
    clearTimeout(waiting);
    awaited = "";
    if (shown?.by === "mouse") hide();
  }
}, true);
document.addEventListener("pointerdown", () => { keyed = false; }, true);
document.addEventListener("click", (e) => {
  const where = place(e.target);
  if (e.pointerType === "touch") pointer = [e.clientX, e.clientY];
  if (where && (e.pointerType === "touch" || where.matches("label, .vs-set, [data-symbol]"))) show(where, "tap");
  else if (shown?.by !== "mouse") hide();
}, true);
document.addEventListener("keydown", (e) => {
  keyed = e.key === "Tab" || (keyed && /^Arrow/.test(e.key));
  if (e.key !== "Escape" || !shown) return;
  hide();
  e.preventDefault(); // one Esc ends one thing (stage.js)
}, true);
document.addEventListener("focusin", (e) => {
  if (!keyed) return;
  const row = e.target instanceof Element ? e.target.closest("form, .mantine-Flex-root:has(label)") : null;
  const own = e.target instanceof Element ? e.target.closest(`[data-symbol], ${STOPS}, .u-legend .u-series th`) : null;
  const where = own ?? row?.querySelector(".vs-set") ?? row?.querySelector("label");
  if (where && symbolsOf(where).length) show(where, "focus");
  else hide();
});
// the focus that comes to a row may scroll it into view
document.addEventListener("scroll", () => {
  const box = shown?.by === "focus" && shown.where.isConnected && shown.where.getBoundingClientRect();
  if (box && box.bottom > 0 && box.top < innerHeight) put();
  else if (shown) hide();
}, true);
addEventListener("blur", hide);
// What is sent again takes its elements with it: the tip goes over to the one that stands there now.
setInterval(() => {
  setLabels();
  if (!shown) return;
  if (!shown.where.isConnected) {
    const now = shown.by === "focus" ? null : place(document.elementFromPoint(...pointer));
    const { by, symbols } = shown;
    if (same(now) !== symbols.join()) return hide();
    shown = { where: now, symbols, by };
    now.setAttribute("aria-describedby", tip.id);
  }
  write();
}, 300);

// By keyboard, a table is one stop, at the first of its cells that explain themselves; arrow keys lead to the others. Tables
// are sent again and again: the focus goes over to the cell that says the same.
const STOPS = ".vs-facts td:first-child";
const cellsOf = (table) => [...table.querySelectorAll(STOPS)].filter((cell) => symbolsOf(cell).length);
let stop = null; // { cell, text, number } of the focused cell, its text and its place among those of the page
const setStops = () => {
  for (const table of document.querySelectorAll(".vs-facts")) {
    const cells = cellsOf(table), now = cells.find((cell) => cell === document.activeElement) ?? cells[0];
    for (const cell of cells) {
      const index = cell === now ? 0 : -1;
      if (cell.getAttribute("tabindex") !== `${index}`) cell.tabIndex = index;
    }
  }
};
const refocus = () => {
  setStops();
  if (!stop || stop.cell.isConnected || document.activeElement !== document.body) return;
  const alike = [...document.querySelectorAll(STOPS)].filter((cell) => cell.textContent === stop.text);
  const again = alike[Math.min(stop.number, alike.length - 1)];
  if (again) {
    again.tabIndex = 0;
    keyed = true;
    again.focus({ preventScroll: true });
  } else stop = null;
};
new MutationObserver(refocus).observe(document.body, { subtree: true, childList: true });
document.addEventListener("focusin", (e) => {
  const cell = e.target instanceof Element && e.target.matches(STOPS) ? e.target : null;
  const alike = cell ? [...document.querySelectorAll(STOPS)].filter((each) => each.textContent === cell.textContent) : [];
  stop = cell && { cell, text: cell.textContent, number: alike.indexOf(cell) };
}, true);
document.addEventListener("pointerdown", () => { stop = null; }, true);
document.addEventListener("keydown", (e) => {
  const cell = e.target instanceof Element && e.target.matches(STOPS) ? e.target : null;
  if (!cell || !/^Arrow(Up|Down)$/.test(e.key)) return;
  const cells = cellsOf(cell.closest(".vs-facts")), next = cells[cells.indexOf(cell) + (e.key === "ArrowDown" ? 1 : -1)];
  e.preventDefault();
  e.stopPropagation();
  if (!next) return;
  next.tabIndex = 0;
  keyed = true; // as by Tab: the tip is shown
  next.focus();
}, true);

// A page of its own, above the others.
window.vsmrcDialog = (name, content) => {
  const [dialog, head, title, close] = ["dialog", "header", "h2", "button"].map((tag) => document.createElement(tag));
  dialog.className = "vs-glossary";
  [title.textContent, close.textContent] = [name, "Close"];
  dialog.setAttribute("aria-label", name);
  close.addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => dialog.remove());
  dialog.addEventListener("keydown", (key) => key.stopPropagation());
  dialog.addEventListener("click", (at) => { if (at.target === dialog) dialog.close(); });
  Object.assign(title, { tabIndex: -1, autofocus: true });
  head.append(title, close);
  dialog.append(head, content);
  document.body.append(dialog);
  dialog.showModal();
};
document.addEventListener("click", (e) => {
  if (!(e.target instanceof Element && e.target.closest("[data-glossary]")) || !template()) return; // no run yet
  const list = template().content.querySelector("dl").cloneNode(true), values = present();
  for (const entry of list.children) {
    const now = document.createElement("dd");
    now.className = "vs-present";
    now.textContent = values[entry.dataset.of] ? `now ${values[entry.dataset.of]}` : "";
    entry.append(now);
  }
  typeset(list);
  window.vsmrcDialog("Symbols", list);
});
