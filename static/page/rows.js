// Numbers: a text field reports when the user is done with it, and a slider when it is let go.
// The marks are those of app/dashboard/theme/style.py.
const LEFT = "\u200b", ENTERED = "\u2062";
// the menus in a form search with a text field of their own
const field = (e) => e.target instanceof HTMLInputElement && e.target.matches("form .mantine-TextInput-input")
  ? e.target : null;
let writing = false;
const write = (input, text) => {
  writing = true;
  window.vsmrcEnter(input, text);
  writing = false;
};
// viser sends no more than a message in 50 ms and drops those in between, so a mark may get lost. The server takes it off.
// An odd and an even number of marks in turn: by that the server knows what it has received twice.
const MARKS = /[\u200b-\u200d\u2060-\u2062]/g;
const sendMarked = (input, text, mark) => {
  const plain = text.replace(MARKS, ""); // a slow server has not taken off those of the turn before
  const turn = (input.vsmrcTurnOfMarks = { even: !input.vsmrcTurnOfMarks?.even });
  const send = (marked, again) => {
    write(input, marked);
    setTimeout(() => {
      if (again && input.vsmrcTurnOfMarks === turn && input.value === marked) send(marked + mark + mark, again - 1);
    }, 700);
  };
  send(plain + (turn.even ? mark + mark : mark), 3);
};
const commit = (input, text, mark) => {
  delete input.dataset.pending;
  sendMarked(input, text, mark);
};
// What is typed counts, also where a value that the server had sent before it knew comes in between.
document.addEventListener("beforeinput", (e) => {
  const input = field(e);
  if (input && input.dataset.pending !== undefined && input.value !== input.vsmrcDraft) write(input, input.vsmrcDraft);
}, true);
// Nor does the field show another value than the one that leaving it applies.
setInterval(() => {
  const input = field({ target: document.activeElement });
  if (input && input.dataset.pending !== undefined && input.value !== input.vsmrcDraft) write(input, input.vsmrcDraft);
}, 300);
document.addEventListener("input", (e) => {
  const input = field(e);
  if (!input || writing) return;
  input.dataset.pending = "";
  input.vsmrcDraft = input.value;
}, true);
document.addEventListener("keydown", (e) => {
  const input = field(e);
  if (!input || (e.key !== "Enter" && e.key !== "Escape") || e.isComposing || e.keyCode === 229) return; // of an input method
  e.preventDefault();
  const pending = input.dataset.pending !== undefined;
  if (e.key === "Enter") commit(input, pending ? input.vsmrcDraft : input.value, ENTERED);
  else if (pending) commit(input, "", LEFT);
  input.blur(); // keys are commands again
}, true);
// A tick of the timeline is looked at: its instant is typed into the field of the time, which stands behind the ticks.
// A finger seeks when it is lifted there, since it may begin to scroll.
const TIME = "div:has(> .vs-ticks) + form";
const seekOf = (target) => (target instanceof Element && target.closest("[data-seek]")?.dataset.seek) || null;
const seek = (t) => {
  const input = document.querySelector(`${TIME} .mantine-TextInput-input`);
  if (input && t !== null) sendMarked(input, t, LEFT);
};
let touched = null; // { id, t } of a finger on a tick
document.addEventListener("pointerdown", (e) => {
  touched = null;
  if (e.button !== 0 || window.vsmrcWatches()) return;
  if (e.pointerType === "touch") touched = { id: e.pointerId, t: seekOf(e.target) };
  else seek(seekOf(e.target));
}, true);
document.addEventListener("pointerup", (e) => {
  if (e.pointerId === touched?.id && seekOf(document.elementFromPoint(e.clientX, e.clientY)) === touched.t) seek(touched.t);
  touched = null;
}, true);
document.addEventListener("pointercancel", () => { touched = null; }, true);
// Another script has a mark to send (rowmenu.js).
document.addEventListener("vsmrc-mark", (e) => sendMarked(e.target, e.target.value, e.detail));
document.addEventListener("focusout", (e) => {
  const input = field(e);
  if (input && input.dataset.pending !== undefined) commit(input, input.vsmrcDraft, LEFT);
}, true);

const SLOT = 60; // ms, longer than viser waits between two messages
let held = null, byKey = false;
const slider = (e) => e.target instanceof Element ? e.target.closest("form .mantine-Slider-root") : null;
// the timeline changes no value, so that nothing is previewed or taken back
const hold = (row, key) => { held = row; byKey = key; row.dataset.held = row.matches(TIME) ? "time" : "value"; row.vsmrcTurn = null; };
const letGo = (mark) => {
  if (!held) return;
  const row = held, turn = (row.vsmrcTurn = {});
  held = null;
  // viser's form says that it has been changed right behind the mark, and of two that wait for the slot only the last is
  // sent: the slot must be free. Its timer of 50 ms may send the last position, and begins anew then: later than two more.
  requestAnimationFrame(() => setTimeout(() => setTimeout(() => {
    const input = row.querySelector("input.mantine-TextInput-input");
    if (row.vsmrcTurn !== turn || !input) return;
    sendMarked(input, input.value, mark);
    delete row.dataset.held;
  }, SLOT), SLOT));
};
const moves = (e) => /^(Arrow|Home|End)/.test(e.key);
// A slider's step is a fine one (FINE_STEP in widgets/fields/field_binding.py). Ten of them are a step by mouse or
// key, and one with Shift, when the mouse also moves it a tenth as far. Between two pixels an event gets a place of its
// own.
const TIMES = 10, STEPS = 500;
let place = 0, mouse = 0;
const lies = (e, x) => Object.defineProperty(e, "clientX", { value: x });
const onStep = (box, x) => box.left + (Math.round(((x - box.left) / box.width) * STEPS) / STEPS) * box.width;
const track = (within) => within.querySelector(".mantine-Slider-track");
window.addEventListener("mousedown", (e) => {
  if (!slider(e) || !e.isTrusted) return;
  place = mouse = e.clientX;
  lies(e, onStep(track(slider(e)).getBoundingClientRect(), place));
}, true);
window.addEventListener("mousemove", (e) => {
  if (!held || byKey || !e.isTrusted) return;
  place += (e.clientX - mouse) * (e.shiftKey ? 1 / TIMES : 1);
  mouse = e.clientX;
  lies(e, e.shiftKey ? place : onStep(track(held).getBoundingClientRect(), place));
}, true);
document.addEventListener("keydown", (e) => {
  if (!slider(e) || !/^Arrow/.test(e.key)) return;
  e.preventDefault();
  e.stopPropagation(); // the slider would take a fine step
  const thumb = slider(e).querySelector("[role=slider]"), steps = e.shiftKey ? STEPS * TIMES : STEPS;
  const next = Math.round(thumb.ariaValueNow * steps + (/Right|Up/.test(e.key) ? 1 : -1));
  const on = track(slider(e)), box = on.getBoundingClientRect();
  const x = box.left + (Math.min(Math.max(next, 0), steps) / steps) * box.width;
  for (const kind of ["mousedown", "mouseup"])
    on.dispatchEvent(lies(new MouseEvent(kind, { bubbles: true, cancelable: true, clientY: box.top }), x));
  thumb.focus(); // a press focuses what is around it
}, true);
for (const kind of ["mousedown", "touchstart"])
  document.addEventListener(kind, (e) => { const s = slider(e); if (s && e.isTrusted) hold(s.closest("form"), false); }, true);
for (const kind of ["mouseup", "touchend"])
  document.addEventListener(kind, (e) => { if (e.isTrusted) letGo("\u200c"); }, true);
document.addEventListener("touchcancel", (e) => { if (e.isTrusted) letGo("\u200d"); }, true);
// A finger that goes up or down from a slider scrolls (page.css lets it), and the slider gets its value back.
const NEAR = 10; // px that a finger goes before it is known which way
let finger = null; // where it began, null once it is known
window.addEventListener("touchstart", (e) => {
  finger = slider(e) && e.touches.length === 1 ? { x: e.touches[0].clientX, y: e.touches[0].clientY } : null;
}, { capture: true, passive: true });
window.addEventListener("touchmove", (e) => {
  if (!finger || !held) return;
  const x = Math.abs(e.touches[0].clientX - finger.x), y = Math.abs(e.touches[0].clientY - finger.y);
  if (Math.max(x, y) < NEAR) e.stopPropagation();
  else if (y > x) takeBack();
  if (Math.max(x, y) >= NEAR) finger = null;
}, { capture: true, passive: true });
const takeBack = () => {
  letGo("\u200d");
  document.dispatchEvent(new MouseEvent("mouseup", { bubbles: true }));
  document.dispatchEvent(new Event("touchend", { bubbles: true }));
};
document.addEventListener("keydown", (e) => {
  const s = slider(e);
  if (e.key === "Escape" && held) {
    takeBack();
    e.preventDefault(); // one Esc ends one thing (stage.js)
  } else if (s && moves(e)) hold(s.closest("form"), true);
}, true);
document.addEventListener("keyup", (e) => { if (moves(e)) letGo("\u200c"); }, true);
// the keyup goes elsewhere then; a mouse stays with the page that it was pressed on
window.addEventListener("blur", () => { if (byKey) letGo("\u200c"); });
