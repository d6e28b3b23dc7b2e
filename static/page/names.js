// Names and roles for whoever hears the page or goes through it by keyboard: many of viser's labels are tied
// to nothing, its icons have no words, a slider's value is a share of its track, and what folds or hides a line
// answers to a mouse only.
const ICONS = { "tabler-icon-list-search": "search all commands" };
// viser writes a key's name as a program does
const KEYS = { arrowleft: "←", arrowright: "→", arrowup: "↑", arrowdown: "↓", pageup: "PgUp", pagedown: "PgDn", end: "End", home: "Home" };
const PLACES = {
  "#root": { role: "main" },
  "[data-dock-region=left]": { role: "region", "aria-label": "plots" },
  "[data-dock-region=right]": { role: "region", "aria-label": "controls" },
  "[data-floating-window]:has(.vs-equation)": { role: "region", "aria-label": "target model" },
  "[data-floating-window]:has(.vs-held)": { role: "region", "aria-label": "what if" },
  "div:has(> .vs-ticks) + form input:not([type=hidden])": { placeholder: "go to t" },
  ".mantine-Notification-closeButton": { "aria-label": "close" },
  ".uplot-container button:not(.vs-measure, .vs-unzoom)": { "aria-label": "enlarge the plot, or make it small again", title: "enlarge" },
  "canvas[data-engine]": { role: "img", "aria-label": "the robot, the surface and the forces in three dimensions" },
};
// what a key presses: by Enter or the space bar, as a click
const PRESSED = ".u-legend .u-label, .mantine-Paper-root > .mantine-Paper-root:has(> .tabler-icon)";
const FOLDER = ".mantine-Paper-root:has(> .mantine-Paper-root > .tabler-icon)";
const set = (element, name, value) => { if (element.getAttribute(name) !== value) element.setAttribute(name, value); };
const press = (element, is) => {
  set(element, "role", "button");
  set(element, "tabindex", "0");
  set(element, is[0], is[1]);
};
const call = () => {
  if (document.title !== "VSMRC Lab") document.title = "VSMRC Lab";
  for (const [selector, attributes] of Object.entries(PLACES))
    for (const place of document.querySelectorAll(selector))
      for (const [name, value] of Object.entries(attributes)) set(place, name, value);
  const named = []; // the controls with their labels, and the folders of their tabs in which they stand
  for (const control of document.querySelectorAll("input:not([type=checkbox], [type=hidden]), [role=slider]")) {
    const row = control.closest("form") ?? control.closest(".mantine-Flex-root:has(label)");
    const tied = control.labels?.length ? control.labels : (row?.querySelectorAll("label") ?? []); // a form may have several
    const label = [...tied].map((each) => each.textContent.trim()).find(Boolean);
    if (!label) continue;
    const folder = control.closest(FOLDER)?.querySelector(":scope > .mantine-Paper-root").textContent.trim();
    named.push({ control, label, folder, tab: control.closest(".mantine-ScrollArea-content") });
    const shown = row?.querySelector("input:not([type=hidden])")?.value;
    const above = row?.parentElement?.querySelector("[data-unit]"); // the note with the unit of a target model's rows
    const unit = /\[(.*)\]/.exec(label)?.[1] ?? above?.dataset.unit ?? "";
    // the time has no number while the run goes on
    if (control.role === "slider") set(control, "aria-valuetext", shown ? `${shown} ${unit}`.trim() : "now");
  }
  for (const { control, label, folder, tab } of named) {
    const twice = named.some((other) =>
      other.label === label && other.tab === tab && other.folder !== folder && other.control.checkVisibility());
    set(control, "aria-label", twice && folder ? `${label}, ${folder}` : label);
  }
  for (const menu of document.querySelectorAll("input[aria-haspopup=listbox]"))
    set(menu, "title", menu.scrollWidth > menu.clientWidth ? menu.value : "");
  for (const key of document.querySelectorAll(".mantine-Spotlight-actionDescription")) {
    const name = key.textContent, written = name.replace(/(?<=^|\+)[a-z]+$/, (last) => KEYS[last] ?? last);
    if (written !== name) key.textContent = written;
  }
  for (const [icon, name] of Object.entries(ICONS))
    for (const drawn of document.querySelectorAll(`button .${icon}`)) set(drawn.closest("button"), "aria-label", name);
  for (const element of document.querySelectorAll(PRESSED)) {
    const line = element.closest(".u-series");
    if (!line) press(element, ["aria-expanded", `${!element.querySelector(".tabler-icon-chevron-down")}`]);
    else if (line.previousElementSibling) press(element, ["aria-pressed", `${!line.matches(".u-off")}`]); // not the axis
  }
  for (const plot of document.querySelectorAll(".uplot")) {
    const title = plot.querySelector(".u-title")?.textContent.trim().replace(/\s+/g, " ") ?? "";
    for (const canvas of plot.querySelectorAll("canvas")) {
      set(canvas, "role", "img");
      set(canvas, "aria-label", `plot: ${title}`);
    }
    set(plot.querySelector("table"), "aria-label", `lines of ${title}`);
    set(plot.parentElement.closest(".uplot-container"), "role", "group");
    set(plot.parentElement.closest(".uplot-container"), "aria-label", title);
  }
};
setInterval(call, 500);
document.addEventListener("keydown", (e) => {
  if (!(e.target instanceof Element) || !/^( |Enter)$/.test(e.key) || !e.target.matches(PRESSED)) return;
  e.preventDefault();
  e.target.dispatchEvent(new MouseEvent("click", { bubbles: true, ctrlKey: e.ctrlKey, metaKey: e.metaKey }));
}, true);
