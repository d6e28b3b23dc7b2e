// Page of one of a class (app/gateway/pages.py): asks once a second what the lecturer asks, and sends the answer.
const place = document.getElementById("class"), message = document.getElementById("message");
const news = document.getElementById("news"); // for screen readers: only what is new
// what a lesson writes comes as HTML made of its Markdown (app/lessons/markup.py); everything else is text
const make = (tag, name, html) => Object.assign(document.createElement(tag), { className: name ?? "", innerHTML: html ?? "" });
const text = (tag, name, textContent) => Object.assign(document.createElement(tag), { className: name, textContent });
const spoken = (element) => Object.assign(element, { lang: question.language }); // what the lesson says
const COUNT = 25, WIDE = 320, HIGH = 200, LEFT = 8, RIGHT = 312, TOP = 10, BOTTOM = 180;
// what this page says itself, in the language of the lesson, or English
const WORDS = {
  en: {
    lang: "en", decimal: ".", answer: "Answer", change: "Change", own: "your answer", over: "over",
    draw: "draw with a finger, or with the arrow keys", given: "Answered. You may change it until the answers are shown.",
    waiting: "Waiting for the next question…", number: "A number, such as 12.5.", line: "Draw a line first.",
    twice: (given, one, other) => `${given} can be read in two ways: write ${one} or ${other}.`,
    gone: "This link is no longer valid; ask for the new one.", silent: "The server does not answer; try again.",
    nowhere: "This link leads nowhere any more: ask for a new one.",
  },
  de: {
    lang: "de", decimal: ",", answer: "Antworten", change: "Ändern", own: "Antwort", over: "über",
    draw: "mit dem Finger oder mit den Pfeiltasten zeichnen", given: "Beantwortet. Bis die Antworten gezeigt werden, lässt es sich ändern.",
    waiting: "Warten auf die nächste Frage…", number: "Eine Zahl wie 12,5.", line: "Erst eine Linie zeichnen.",
    twice: (given, one, other) => `${given} ist auf zwei Arten lesbar: ${one} oder ${other} schreiben.`,
    gone: "Dieser Link gilt nicht mehr; nach dem neuen fragen.", silent: "Der Server antwortet nicht; noch einmal versuchen.",
    nowhere: "Dieser Link führt nirgends mehr hin: nach einem neuen fragen.",
  },
};
let words = WORDS.en; // those of the last question
const written = (number) => `${number}`.replace(".", words.decimal);
const tell = (textContent, lang = words.lang) => Object.assign(message, { lang, textContent });
let shown = "", question = null, own = null, drawn = null; // drawn: number of the question on the page

const send = async (given) => {
  const { number } = question;
  tell("");
  try {
    const answer = await fetch("answer", {
      method: "POST", headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ number, given }),
    });
    if ([403, 404].includes(answer.status)) {
      tell(words.gone);
      return;
    }
    const reply = await answer.json();
    if (number !== question?.number) return; // another question has come meanwhile
    if (answer.ok) { own = reply.own; draw(); } else tell(reply.refused, "en");
  } catch { tell(words.silent); }
};

const options = () => question.options.map((option, k) => {
  const button = spoken(make("button", "option", `<b>${"ABCDE"[k]}</b> ${option}`));
  button.setAttribute("aria-pressed", String(own === k + 1));
  button.disabled = !question.open;
  button.addEventListener("click", () => send(k + 1));
  return button;
});

const number = () => {
  const form = make("form"), label = text("label", "", question.unit ? `in ${question.unit}` : "");
  // "decimal" would bring a keypad without a minus on an iPhone
  const input = Object.assign(make("input"), { inputMode: "text", autocomplete: "off", value: own ?? "", disabled: !question.open, required: true });
  input.setAttribute("aria-label", `${words.own} ${question.unit}`);
  const button = Object.assign(make("button", "", own === null ? words.answer : words.change), { disabled: !question.open });
  form.append(input, label, button);
  form.addEventListener("submit", (e) => {
    e.preventDefault();
    const given = input.value.trim().replace("−", "-"), value = Number(given.replace(",", "."));
    if (/^-?[1-9]\d{0,2},\d{3}$/.test(given)) // with a comma of decimals, or of thousands
      tell(words.twice(given, given.replace(",", "."), given.replace(",", "")));
    else if (Number.isFinite(value) && given) send(value); else tell(words.number);
  });
  return [form];
};

const curve = () => {
  const space = "http://www.w3.org/2000/svg";
  const part = (name, attributes) => {
    const element = document.createElementNS(space, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const svg = part("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "application", tabindex: "0",
    "aria-label": `${question.axis}: ${words.draw}` });
  const x = (k) => LEFT + ((RIGHT - LEFT) * k) / (COUNT - 1);
  const y = (v) => BOTTOM - ((BOTTOM - TOP) * (v - question.low)) / (question.high - question.low);
  svg.append(part("rect", { x: LEFT, y: TOP, width: RIGHT - LEFT, height: BOTTOM - TOP }));
  if (question.low < 0 && question.high > 0) svg.append(part("line", { x1: LEFT, x2: RIGHT, y1: y(0), y2: y(0) }));
  const path = svg.appendChild(part("path", {})), pen = svg.appendChild(part("circle", { r: 5 }));
  const ends = text("p", "ends dim", `: ${[question.low, question.high].map(written).join(" … ")}, ${words.over} ${[question.start, question.end].map(written).join(" … ")} s`);
  ends.prepend(spoken(text("span", "", question.axis)));
  const values = Array.isArray(own) ? [...own] : Array(COUNT).fill(null);
  const filled = () => {
    const known = values.map((v, k) => [k, v]).filter(([, v]) => v !== null);
    return known.length ? values.map((v, k) => {
      if (v !== null) return v;
      const before = known.findLast(([j]) => j < k), after = known.find(([j]) => j > k);
      if (!before || !after) return (before ?? after)[1];
      return before[1] + ((after[1] - before[1]) * (k - before[0])) / (after[0] - before[0]);
    }) : null;
  };
  let drawing = false, last = null, hand = 0, at = 0; // at: instant that the arrow keys change
  const show = () => {
    const line = filled();
    path.setAttribute("d", (line ?? []).map((v, k) => `${k ? "L" : "M"} ${x(k)} ${y(v)}`).join(" "));
    pen.setAttribute("cx", x(at));
    pen.setAttribute("cy", y(line?.[at] ?? (question.low + question.high) / 2));
    pen.setAttribute("visibility", document.activeElement === svg && question.open ? "visible" : "hidden");
  };
  for (const kind of ["focus", "blur"]) svg.addEventListener(kind, show);
  const take = (e) => {
    const box = svg.getBoundingClientRect();
    const across = ((e.clientX - box.left) / box.width) * WIDE, down = ((e.clientY - box.top) / box.height) * HIGH;
    const k = Math.min(Math.max(Math.round(((across - LEFT) / (RIGHT - LEFT)) * (COUNT - 1)), 0), COUNT - 1);
    const fraction = Math.min(Math.max((BOTTOM - down) / (BOTTOM - TOP), 0), 1);
    const value = question.low + fraction * (question.high - question.low), from = last ?? [k, value];
    for (let j = Math.min(from[0], k); j <= Math.max(from[0], k); j++)
      values[j] = from[0] === k ? value : from[1] + ((value - from[1]) * (j - from[0])) / (k - from[0]);
    last = [k, value];
    show();
  };
  const button = Object.assign(make("button", "", own === null ? words.answer : words.change), { disabled: !question.open });
  if (question.open) {
    svg.addEventListener("pointerdown", (e) => { if (e.button !== 0) return; drawing = true; hand = e.pointerId; last = null; svg.setPointerCapture(e.pointerId); take(e); e.preventDefault(); });
    svg.addEventListener("pointermove", (e) => {
      if (e.pointerId !== hand) return;
      if (e.pointerType === "mouse" && e.buttons === 0) drawing = false; // its button went up elsewhere
      if (drawing) take(e);
    });
    for (const kind of ["pointerup", "pointercancel"]) svg.addEventListener(kind, (e) => { if (e.pointerId === hand) drawing = false; });
    svg.addEventListener("keydown", (e) => {
      if (!/^Arrow/.test(e.key)) return;
      e.preventDefault();
      if (e.key === "ArrowLeft") at = Math.max(at - 1, 0);
      else if (e.key === "ArrowRight") at = Math.min(at + 1, COUNT - 1);
      else {
        const now = filled()?.[at] ?? (question.low + question.high) / 2, step = (question.high - question.low) / 50;
        values[at] = Math.min(Math.max(now + (e.key === "ArrowUp" ? step : -step), question.low), question.high);
      }
      show();
    });
  }
  button.addEventListener("click", () => {
    const drawn = filled();
    if (drawn) send(drawn); else tell(words.line);
  });
  show();
  return [svg, ends, button];
};

const controls = () => [...place.querySelectorAll("button, input, svg")];
const draw = () => {
  const focused = drawn === question?.number ? controls().indexOf(document.activeElement) : -1; // it is replaced
  drawn = question?.number;
  if (question) words = WORDS[question.language] ?? WORDS.en;
  Object.assign(place, { lang: words.lang }).replaceChildren();
  if (!question) return place.append(text("p", "dim", words.waiting));
  place.append(spoken(make("h1", "", question.ask)));
  place.append(...{ choice: options, number, curve }[question.kind]());
  if (question.told) place.append(make("div", "result", question.told));
  else if (own !== null) place.append(text("p", "dim", words.given));
  controls()[focused]?.focus();
  const heard = place.querySelector(question.told ? ".result" : own === null ? "h1" : "p.dim:last-child");
  Object.assign(news, { lang: heard.lang || words.lang, textContent: heard.textContent });
};

const ask = async () => {
  try {
    const answer = await fetch("question", { cache: "no-store" });
    if (answer.ok) {
      const now = await answer.json(), seen = JSON.stringify(now.question);
      if (seen !== shown) { // what is being typed or drawn stays while the question does
        const fresh = now.question?.number !== question?.number;
        shown = seen;
        question = now.question;
        if (fresh || !question?.open) own = now.own;
        if (fresh) tell("");
        draw();
      }
    } else if (answer.status === 404 || answer.status === 403) {
      shown = ""; // it may lead somewhere again
      place.replaceChildren(text("p", "", words.nowhere));
    }
  } catch { /* asked again */ }
  setTimeout(ask, 900 + 200 * Math.random());
};
ask();
