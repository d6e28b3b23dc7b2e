"""What is wrong with the looks of a page: text that is cut or covered, panels in each other's way, faint letters.

`faults(page)` names each by its text; a test or a person fixes what it lists.
"""

import time
from collections.abc import Callable

from playwright.sync_api import Page

SETTLED = 60.0  # s, for a machine that has other things to do
LOOKS = 5  # at least, however long each takes

_SCRIPT = """
() => {
  const faults = new Set();
  const say = (what, element, text) => faults.add(`${what}: ${(text ?? element.textContent).trim().slice(0, 60)}`);
  const root = document.documentElement;
  if (root.scrollWidth > innerWidth) faults.add(`the page is ${root.scrollWidth} px wide, the window ${innerWidth}`);

  // the part of a box that is left by everything around the element that clips, in either direction
  const clips = (element) => {
    const found = [];
    for (let e = element; e && e !== root; e = e.parentElement) {
      const style = getComputedStyle(e);
      if (style.overflowX !== "visible" || style.overflowY !== "visible") found.push(e.getBoundingClientRect());
      if (style.position === "fixed") break;
    }
    return [...found, new DOMRect(0, 0, innerWidth, innerHeight)];
  };
  const share = (box, boxes, low, high) => {
    const start = Math.max(box[low], ...boxes.map((b) => b[low]));
    return (Math.min(box[high], ...boxes.map((b) => b[high])) - start) / (box[high] - box[low]);
  };
  const shown = (e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true });

  const things = []; // what must not cover each other: [element, box, text]
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.data.trim(), element = walker.currentNode.parentElement;
    if (!text || !element || /^(STYLE|SCRIPT|NOSCRIPT|TEMPLATE)$/.test(element.tagName) || !shown(element)) continue;
    const range = document.createRange();
    range.selectNodeContents(walker.currentNode);
    const around = clips(element);
    for (const box of range.getClientRects()) {
      if (box.width < 1 || box.height < 1 || share(box, around, "top", "bottom") < 0.6) continue; // scrolled away
      if (share(box, around, "left", "right") < 1 - 1.5 / box.width) say("cut", element, text);
      things.push([element, box, text]);
    }
    if (getComputedStyle(element).textOverflow === "ellipsis" && element.scrollWidth > element.clientWidth + 1)
      say("cut", element, text);
  }
  const controls = "input:not([type=checkbox]), .mantine-Slider-root, button, .uplot-container canvas";
  for (const input of document.querySelectorAll(controls)) {
    const box = input.getBoundingClientRect();
    if (!shown(input) || box.width < 2 || share(box, clips(input), "top", "bottom") < 0.6) continue;
    if (input.matches("input[type=text], input:not([type])") && input.scrollWidth > input.clientWidth + 1)
      say("cut", input, input.value);
    things.push([input, box, input.value || input.ariaLabel || input.textContent || input.className]);
  }
  const floating = "[data-floating-window], .vs-hints, .mantine-Modal-content, .mantine-Popover-dropdown";
  const floats = (e) => e.closest(floating);
  things.forEach(([one, a, text], i) => things.slice(i + 1).forEach(([other, b, otherText]) => {
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (!(wide > 2 && high > 4)) return; // first: few pairs are left to look up the tree for
    if (one.contains(other) || other.contains(one) || floats(one) !== floats(other)) return;
    if (one.closest("math, .uplot") && one.closest("math, .uplot") === other.closest("math, .uplot")) return;
    say("one on the other", one, `${text.slice(0, 28)} | ${otherText.slice(0, 28)}`);
  }));

  const panels = [...document.querySelectorAll("[data-dock-region], [data-floating-window], .vs-hints")].filter(shown);
  panels.forEach((one, i) => panels.slice(i + 1).forEach((other) => {
    const a = one.getBoundingClientRect(), b = other.getBoundingClientRect();
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    const titles = [one, other].map((panel) => panel.innerText.slice(0, 25)).join(" | ");
    if (wide > 2 && high > 2) say("panels overlap", one, titles);
  }));

  // WCAG AA: 4.5, or 3 for large letters; disabled controls are exempt
  const rgba = (color) => (color.match(/[\\d.]+/g) ?? [0, 0, 0, 0]).map(Number);
  const over = (top, below) => below.map((c, i) => (top[3] ?? 1) * top[i] + (1 - (top[3] ?? 1)) * c);
  const luminance = (color) => color.map((c) => c / 255)
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + [0.2126, 0.7152, 0.0722][i] * c, 0);
  const seen = new Set(things.map(([element]) => element).filter((e) => e.innerText?.trim() || e.value));
  for (const element of seen) {
    if (element.closest(":disabled, [data-disabled], .mantine-Notification-root, .u-legend")) continue;
    const chain = [];
    for (let e = element; e; e = e.parentElement) chain.unshift(getComputedStyle(e));
    let ground = [255, 255, 255], opacity = 1;
    for (const style of chain) {
      ground = over(rgba(style.backgroundColor), ground);
      opacity *= Number(style.opacity);
    }
    const own = rgba(chain.at(-1).color), ink = over([own[0], own[1], own[2], (own[3] ?? 1) * opacity], ground);
    const [low, high] = [luminance(ink), luminance(ground)].sort((a, b) => a - b);
    const ratio = (high + 0.05) / (low + 0.05), least = parseFloat(chain.at(-1).fontSize) >= 24 ? 3 : 4.5;
    if (ratio < least) say(`faint (${ratio.toFixed(2)})`, element, element.value || element.innerText);
  }
  return [...faults];
}
"""


def faults(page: Page) -> list[str]:
    """One line for each thing that is cut, covered, too faint to read or wider than the window; best an empty list."""
    return page.evaluate(_SCRIPT)


def lasting(page: Page, look: Callable[[Page], list[str]]) -> list[str]:
    """What a look still finds after a while: a page that is being laid out has faults that go by themselves."""
    until, looks = time.monotonic() + SETTLED, 0
    while found := look(page):
        looks += 1
        if looks >= LOOKS and time.monotonic() > until:
            break
        page.wait_for_timeout(200)
    return found


def lasting_faults(page: Page) -> list[str]:
    """The faults that are still there after a while."""
    return lasting(page, faults)
