// The plots beside a 3-D playback: a line in each at the instant that viser's player shows, which its clock tells.
const aside = document.querySelector("#vs-plots"), svg = aside.querySelector("svg");
const { width, height } = svg.viewBox.baseVal, begin = Number(aside.dataset.begin);
const lines = JSON.parse(aside.dataset.panels).map((panel) => {
  const line = document.createElementNS(svg.namespaceURI, "line");
  for (const [name, value] of Object.entries({ y1: panel.top * height, y2: panel.bottom * height, stroke: "#0e42a0" }))
    line.setAttribute(name, value);
  svg.append(line);
  return { panel, line };
});
aside.querySelector("button").addEventListener("click", () => aside.classList.toggle("folded"));
setInterval(() => {
  const clock = document.querySelector("input.mantine-NumberInput-input");
  if (!clock) return;
  const t = begin + parseFloat(clock.value);
  for (const { panel, line } of lines) {
    const { left, right, first, last } = panel, share = Math.min(1, Math.max(0, (t - first) / (last - first)));
    for (const end of ["x1", "x2"]) line.setAttribute(end, width * (left + share * (right - left)));
  }
}, 100);
