// viser says that a file was uploaded successfully when its bytes have come, also where it is refused then. Whether it is
// taken the page tells itself; of viser's notification its progress stays.
const NOTES = ".mantine-Notifications-root", seen = new WeakSet();
const hide = () => {
  for (const tick of document.querySelectorAll(`${NOTES} .tabler-icon-check`)) {
    const note = tick.closest(".mantine-Notification-root");
    if (/^Uploading /.test(note?.textContent ?? "")) note.hidden = true;
  }
};
setInterval(() => {
  for (const place of document.querySelectorAll(NOTES)) {
    if (seen.has(place)) continue;
    seen.add(place);
    new MutationObserver(hide).observe(place, { childList: true, subtree: true });
    hide();
  }
}, 500);
