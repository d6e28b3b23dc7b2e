// Parts that are sent anew several times a second (data-live) are changed in place. Elements that come and go have the
// browser match half of the page with the style sheet again, and lose what is selected or has the focus.
const html = Object.getOwnPropertyDescriptor(Element.prototype, "innerHTML");
const sent = new WeakMap(); // content that was last sent to each part; the shown one may differ, since scripts change it
const names = ({ childNodes }) => [...childNodes].map((node) => node.nodeName).join();
const change = (shown, before, after) => {
  if (before.isEqualNode(after)) return;
  if (!(after instanceof Element)) { shown.data = after.data; return; }
  for (const { name } of [...before.attributes, ...after.attributes]) {
    const value = after.getAttribute(name);
    if (value === before.getAttribute(name)) continue;
    if (value === null) shown.removeAttribute(name);
    else shown.setAttribute(name, value);
  }
  changeWithin(shown, before, after);
};
const changeWithin = (shown, before, after) => {
  if (names(shown) !== names(before)) { shown.replaceChildren(...after.cloneNode(true).childNodes); return; }
  const old = [...before.childNodes], now = [...after.childNodes], nodes = [...shown.childNodes];
  if (names(before) === names(after)) { nodes.forEach((node, i) => change(node, old[i], now[i])); return; }
  // only what is between the equal ones at both ends comes and goes
  const both = Math.min(old.length, now.length);
  let first = 0, last = 0;
  while (first < both && old[first].isEqualNode(now[first])) first++;
  while (last < both - first && old.at(-1 - last).isEqualNode(now.at(-1 - last))) last++;
  for (const node of nodes.slice(first, old.length - last)) node.remove();
  const next = nodes[old.length - last] ?? null;
  for (const node of now.slice(first, now.length - last)) shown.insertBefore(node.cloneNode(true), next);
};
Object.defineProperty(Element.prototype, "innerHTML", {
  ...html,
  set(text) {
    if (!/^<\w+ [^>]*data-live/.test(text)) {
      sent.delete(this);
      html.set.call(this, text);
      return;
    }
    const template = document.createElement("template");
    html.set.call(template, text);
    changeWithin(this, sent.get(this) ?? document.createDocumentFragment(), template.content);
    sent.set(this, template.content);
  },
});
