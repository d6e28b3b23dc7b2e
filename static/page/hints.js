// The first steps, once per browser; without storage (a private window) once per page.
const shown = "vsmrc.hints";
const recall = () => { try { return localStorage.getItem(shown); } catch { return null; } };
const hints = recall() === null && document.querySelector("template#vs-hints")?.content.firstElementChild.cloneNode(true);
if (hints) {
  const dismiss = () => {
    hints.remove();
    document.removeEventListener("keydown", onKey, true);
    try { localStorage.setItem(shown, "dismissed"); } catch { /* then once per page */ }
  };
  // G begins the guided minute, whose texts take this place
  const onKey = (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.defaultPrevented || !hints.checkVisibility()) return; // meant for something else
    if (e.key === "Escape") {
      if (document.querySelector("dialog[open], .mantine-Spotlight-content, [role=listbox]")) return;
      e.preventDefault(); // one Esc ends one thing (stage.js)
    }
    if (e.key === "Escape" || (/^g$/i.test(e.key) && !e.target.closest?.("input, textarea"))) dismiss();
  };
  for (const button of hints.querySelectorAll("button")) button.addEventListener("click", dismiss);
  document.addEventListener("keydown", onKey, true);
  document.body.append(hints);
}
