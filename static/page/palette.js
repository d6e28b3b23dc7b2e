// Tabs of the controls, opened by a button that names one, or from the command palette: there "Controls: World" opens that
// tab (app/dashboard/panels/tabs.py), and "Lesson: ..." the tab of the lesson that the server begins.
document.addEventListener("click", (e) => {
  if (!(e.target instanceof Element)) return;
  const command = e.target.closest(".mantine-Spotlight-action")?.querySelector(".mantine-Spotlight-actionLabel")?.textContent ?? "";
  const title = e.target.closest("[data-tab]")?.dataset.tab
    ?? (command.startsWith("Lesson: ") ? "Lessons" : command.match(/^Controls: (.+)$/)?.[1]);
  if (!title) return;
  const tab = [...document.querySelectorAll("[role=tab]")].find((each) => each.textContent.trim() === title);
  window.vsmrcOpenTab(tab);
  if (command) enter(tab);
}, true);
// The keyboard goes on at the tab once the palette has gone, which gives the focus back to where it was.
const enter = (tab) => {
  if (document.querySelector(".mantine-Spotlight-search")) setTimeout(() => enter(tab), 50);
  else tab?.focus();
};
// Keys typed before the palette has its field are its text, and no commands of the page. PATIENCE: ms, in case it never opens.
const PATIENCE = 2000;
const calls = (e) => (e.ctrlKey || e.metaKey) && !e.altKey && (e.shiftKey ? /^p$/i : /^k$/i).test(e.key);
let called = -Infinity, early = "";
document.addEventListener("keydown", (e) => {
  if (window.vsmrcTyping(e)) {
    // viser's hotkey spares text fields
    if (!calls(e) || e.target.matches(".mantine-Spotlight-search")) return;
    e.preventDefault();
    e.stopPropagation();
    e.target.blur();
    const { key, code, ctrlKey, metaKey, shiftKey } = e;
    document.documentElement.dispatchEvent(new KeyboardEvent("keydown", { key, code, ctrlKey, metaKey, shiftKey, bubbles: true }));
    return;
  }
  if (calls(e)) [called, early] = [e.timeStamp, ""];
  else if (e.timeStamp - called < PATIENCE && e.key.length === 1 && !e.ctrlKey && !e.metaKey && !e.altKey) {
    early += e.key;
    e.preventDefault();
    e.stopPropagation();
  }
}, true);
document.addEventListener("focusin", (e) => {
  if (!(e.target instanceof Element && e.target.matches(".mantine-Spotlight-search"))) return;
  if (early) window.vsmrcEnter(e.target, early);
  [called, early] = [-Infinity, ""];
});
