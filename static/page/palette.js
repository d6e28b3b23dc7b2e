// Tabs of the controls, opened by a button that names one, or from the command palette: there "Controls: World" opens that
// tab (app/dashboard/panels/tabs.py), and "Lesson: ..." the tab of the lesson that the server begins.
document.addEventListener("click", (e) => {
  if (!(e.target instanceof Element)) return;
  const command = e.target.closest(".mantine-Spotlight-action")?.querySelector(".mantine-Spotlight-actionLabel")?.textContent ?? "";
  const title = e.target.closest("[data-tab]")?.dataset.tab
    ?? (command.startsWith("Lesson: ") ? "Lessons" : command.match(/^Controls: (.+)$/)?.[1]);
  if (!title) return;
  window.vsmrcOpenTab([...document.querySelectorAll("[role=tab]")].find((tab) => tab.textContent.trim() === title));
}, true);
