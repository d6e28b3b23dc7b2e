// Text fields as other scripts use them: to write into one as if it were typed, which viser then sends to the server, and
// to know whether a key is being typed into one.
window.vsmrcEnter = (input, text) => {
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, text); // React has replaced it
  input.dispatchEvent(new Event("input", { bubbles: true }));
};
// whether the page only watches (static/gateway/overlay.js): the server drops what it sends
window.vsmrcWatches = () => document.body.classList.contains("vg-watching");
window.vsmrcTyping = (e) => e.target instanceof HTMLElement && /^(INPUT|TEXTAREA|SELECT)$/.test(e.target.tagName);
