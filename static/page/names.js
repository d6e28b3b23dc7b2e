// Names for whoever hears the page or goes through it by keyboard: viser's fields and sliders have labels that are tied to
// nothing, its icons have no words, and a slider's value is a share of its track.
const ICONS = { "tabler-icon-list-search": "search all commands", "tabler-icon-adjustments": "settings of viser" };
const set = (element, name, value) => { if (element.getAttribute(name) !== value) element.setAttribute(name, value); };
const call = () => {
  if (document.title !== "VSMRC Lab") document.title = "VSMRC Lab";
  for (const control of document.querySelectorAll("input:not([type=checkbox], [type=hidden]), [role=slider]")) {
    const row = control.closest("form") ?? control.closest(".mantine-Flex-root:has(label)");
    const label = [...(row?.querySelectorAll("label") ?? [])].map((each) => each.textContent.trim()).find(Boolean);
    if (!label || control.labels?.length) continue;
    set(control, "aria-label", label);
    const shown = row.querySelector("input:not([type=hidden])")?.value;
    if (control.role === "slider" && shown) set(control, "aria-valuetext", `${shown} ${/\[(.*)\]/.exec(label)?.[1] ?? ""}`.trim());
  }
  for (const [icon, name] of Object.entries(ICONS))
    for (const drawn of document.querySelectorAll(`button .${icon}`)) set(drawn.closest("button"), "aria-label", name);
};
setInterval(call, 500);
// what belongs to viser's developers is there for who asks: ?dev behind the address
document.documentElement.toggleAttribute("data-dev", new URLSearchParams(location.search).has("dev"));
