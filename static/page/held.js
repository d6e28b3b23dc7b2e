// On a phone plots and what-if lie beside the sliders, out of sight: while a slider is held, the plot that it matters for
// lies over the scene, and below it the numbers of what-if. When it has been let go, the button that takes its value back
// stands in the scene.
const MATTERS = [ // words of the row's label, and of the plot's title
  [/^(constant d|margin|layer|K_s|F_1|F_2)/, /sliding/],
  [/^(K_f|K_e|K̂_e|B_e|M_e|F_d|λ)|\[N\]|friction/, /force/],
  [/./, /./],
];
let borrowed = null; // plot that lies over the scene: { box, chart, row, width, height }
const forecast = document.createElement("div");
forecast.className = "vs-forecast";
forecast.ariaHidden = "true"; // the what-if window says the same
const putBack = () => {
  if (!borrowed) return;
  const { box, chart, width, height } = borrowed;
  borrowed = null;
  forecast.remove();
  delete box.dataset.heldPlot;
  box.parentElement.style.minHeight = "";
  chart.setSize({ width, height });
};
const borrow = (row) => {
  const label = row.querySelector("label")?.textContent ?? "", title = MATTERS.find(([words]) => words.test(label))[1];
  const shown = Object.values(window.__viserTestpoints?.uplots ?? {}).map(({ chart }) => chart)
    .filter((chart) => chart.root.checkVisibility());
  const chart = shown.find((each) => title.test(each.root.querySelector(".u-title")?.textContent)) ?? shown[0];
  const box = chart?.root.closest(".uplot-container");
  if (!box) return;
  borrowed = { box, chart, row, width: chart.width, height: chart.height };
  box.parentElement.style.minHeight = `${box.parentElement.offsetHeight}px`; // nothing moves under the finger
  box.dataset.heldPlot = "";
  fill();
};
const fill = () => {
  if (!borrowed) return;
  const facts = document.querySelector(".vs-held .vs-foreseen")?.outerHTML ?? "";
  if (forecast.innerHTML !== facts) forecast.innerHTML = facts;
  if (!facts) forecast.remove();
  else if (!forecast.isConnected) document.body.append(forecast);
  const { box, chart } = borrowed, height = Math.max(box.clientHeight - (chart.root.offsetHeight - chart.height) - 8, 90);
  if (Math.abs(height - chart.height) > 2) chart.setSize({ width: box.clientWidth - 4, height });
};
const phone = matchMedia("(max-width: 36em)");
const undo = document.createElement("button");
undo.className = "vs-undo";
// beside the text of what-if: others of the page have the same names
const revert = () => [...document.querySelector(".vs-held")?.closest("div:has(button)")?.querySelectorAll("button") ?? []]
  .find((each) => /^(Revert|Cancel)$/.test(each.textContent.trim()));
let reverted = ""; // text of the row whose button was pressed, until the server has answered
undo.addEventListener("click", () => { revert()?.click(); reverted = undo.textContent; undo.remove(); });
const offer = () => {
  const applied = phone.matches && !borrowed && revert() && document.querySelector(".vs-held .vs-row > span");
  const text = applied ? `Take back ${applied.textContent}` : "";
  if (text !== reverted) reverted = "";
  if (!text || reverted) undo.remove();
  else {
    if (undo.textContent !== text) undo.textContent = text;
    if (!undo.isConnected) document.body.append(undo);
  }
};
setInterval(() => {
  if (borrowed && !(borrowed.row.isConnected && borrowed.box.isConnected)) putBack(); // another page has taken it away
  fill(); // viser gives the plot the height that it has among the others
  offer();
}, 200);
new MutationObserver(() => {
  const row = document.querySelector("form[data-held=value]");
  if (borrowed && borrowed.row !== row) putBack();
  if (!borrowed && row && phone.matches) borrow(row);
}).observe(document.body, { subtree: true, attributes: true, attributeFilter: ["data-held"] });
