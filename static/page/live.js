// Parts that are sent anew several times a second (data-live) are changed in place. Elements that come and go have the
// browser match half of the page with the style sheet again, and lose what is selected or has the focus.
const html = Object.getOwnPropertyDescriptor(Element.prototype, "innerHTML");
const sent = new WeakMap(); // what each of these parts was sent last, as scripts may have added to what is shown
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
  if (names(before) === names(after) && names(shown) === names(after)) {
    for (const [i, node] of [...shown.childNodes].entries()) change(node, before.childNodes[i], after.childNodes[i]);
  } else shown.replaceChildren(...after.cloneNode(true).childNodes);
};
Object.defineProperty(Element.prototype, "innerHTML", {
  ...html,
  set(text) {
    if (!/^<\w+ [^>]*data-live/.test(text)) { html.set.call(this, text); return; }
    const template = document.createElement("template");
    html.set.call(template, text);
    changeWithin(this, sent.get(this) ?? document.createDocumentFragment(), template.content);
    sent.set(this, template.content);
  },
});
