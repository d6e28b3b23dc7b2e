// What the gateway adds to a session's page (app/gateway/server.py): its links, who watches, and what became of it.
const watching = /\/watch\/[^/]+\/$/.test(location.pathname);
const make = (tag, name, text) => Object.assign(document.createElement(tag), { className: name, textContent: text ?? "" });

const root = make("div", "vg");
const bar = root.appendChild(make("div", "vg-bar"));
const notice = root.appendChild(make("div", "vg-card vg-notice"));
notice.hidden = true;
const noticeText = notice.appendChild(make("p", ""));
const dismiss = notice.appendChild(make("button", "", "OK"));
dismiss.addEventListener("click", () => { notice.hidden = true; });
const showNotice = (sentence) => { noticeText.textContent = sentence; notice.hidden = false; };

const copy = async (input, button) => {
  input.select();
  // a page without TLS has no clipboard
  const copied = await navigator.clipboard?.writeText(input.value).then(() => true, () => false) || document.execCommand("copy");
  button.textContent = copied ? "copied" : "press Ctrl+C";
  if (copied) setTimeout(() => { button.textContent = "copy"; }, 1500);
  else input.focus();
};
const link = (card, text, address) => {
  card.append(make("p", "", text));
  const row = card.appendChild(make("div", "vg-link"));
  const input = Object.assign(row.appendChild(make("input")), { readOnly: true, ariaLabel: text, value: new URL(address, location.href).href });
  const button = row.appendChild(make("button", "", "copy"));
  button.addEventListener("click", () => copy(input, button));
};

// of the commands of the page a watcher has the help, as a copy that the page opens by itself
const help = () => {
  const content = document.querySelector("template#vs-help")?.content.cloneNode(true);
  if (content && !document.querySelector("dialog")) window.vsmrcDialog("VSMRC Lab", content);
};
const asksForHelp = (e) => /^[h?]$/i.test(e.key) && !(e.ctrlKey || e.metaKey || e.altKey);

// outlives the reload after a crash, so that the page can say what has happened
const noted = `vsmrc.crashes ${location.pathname}`;
let crashes = null;
let viewers = null;
// viser's list of commands, all of which are refused to who watches
const opensPalette = (e) => (e.ctrlKey || e.metaKey) && (/^k$/i.test(e.key) || (e.shiftKey && /^p$/i.test(e.key)));
const begin = (about) => {
  if (watching) {
    document.body.classList.add("vg-watching");
    // by key no more than by mouse (overlay.css)
    for (const kind of ["keydown", "beforeinput"])
      window.addEventListener(kind, (e) => {
        const control = e.target instanceof Element && e.target.closest(".mantine-Paper-root :is(input, textarea, [role=slider])");
        if (/^(Tab|Escape)$/.test(e.key) || !(control || opensPalette(e) || asksForHelp(e))) return;
        e.preventDefault();
        e.stopImmediatePropagation();
        if (!control && asksForHelp(e)) help();
      }, true);
    window.addEventListener("click", (e) => {
      if (!(e.target instanceof Element && e.target.closest(".vs-tools [data-key=h]"))) return;
      e.stopImmediatePropagation();
      help();
    }, true);
    const text = bar.appendChild(make("span"));
    text.append(make("i", "vg-dot"), "Watching live", make("span", "vg-long vg-dim", " · only the presenter steers"));
    if (about.copy) {
      const form = bar.appendChild(Object.assign(make("form"), { method: "post", action: "copy" }));
      form.append(make("button", "vg-main", "Take a private copy"));
    }
  } else {
    const share = bar.appendChild(make("button", "", "Share"));
    share.setAttribute("aria-expanded", "false");
    viewers = bar.appendChild(make("span", "vg-dim"));
    const card = root.appendChild(make("div", "vg-card"));
    card.hidden = true;
    link(card, "To watch, without steering:", about.links.watch);
    link(card, "To steer together with you:", about.links.steer);
    if (about.links.class) {
      link(card, "For a class, to answer the questions of a lesson:", about.links.class);
      const address = new URL(about.links.class, location.href).href;
      const code = card.appendChild(Object.assign(make("img", "vg-code"), { alt: `QR code of ${address}`, tabIndex: 0 }));
      code.src = `qr?link=${encodeURIComponent(address)}`;
      code.title = "on the whole screen, and back";
      const large = () => {
        const whole = document.body.appendChild(make("div", "vg-large"));
        whole.append(Object.assign(make("img"), { src: code.src, alt: code.alt }), make("p", "", address));
        whole.addEventListener("click", () => whole.remove());
        document.addEventListener("keydown", (e) => {
          if (!whole.isConnected) return;
          whole.remove();
          e.preventDefault();
          e.stopPropagation();
        }, { once: true, capture: true });
      };
      code.addEventListener("click", large);
      code.addEventListener("keydown", (e) => { if (e.key === "Enter") { e.stopPropagation(); if (!e.repeat) large(); } });
    }
    if (about.renew) {
      const form = card.appendChild(Object.assign(make("form", "vg-link"), { method: "post", action: "renew" }));
      const button = form.appendChild(make("button", "", "New links"));
      form.append(make("span", "vg-dim", "take back those above; all other pages close"));
      form.addEventListener("submit", (e) => {
        if (button.disabled || !confirm("Take back all links to this session? Every other page of it closes.")) return e.preventDefault();
        button.disabled = true;
      });
    }
    const show = (open) => {
      if (!open && card.contains(document.activeElement)) share.focus();
      card.hidden = !open;
      share.setAttribute("aria-expanded", String(open));
    };
    share.addEventListener("click", () => show(card.hidden));
    document.addEventListener("keydown", (e) => {
      if (e.key !== "Escape" || e.defaultPrevented || card.hidden) return;
      show(false);
      e.preventDefault(); // one Esc ends one thing
    }, true);
  }
  // keys typed here are text, not commands of the page
  root.addEventListener("keydown", (e) => { if (e.key !== "Escape") e.stopPropagation(); });
  document.body.append(root);
};

// viser's client writes its web socket's address behind ours, again and again, where people would copy it along
const replace = history.replaceState.bind(history);
history.replaceState = (state, title) => replace(state, title, location.pathname);
history.replaceState(null, "");

let gone = false;
const ask = async () => {
  try {
    const answer = await fetch("about", { cache: "no-store" });
    if (answer.ok) {
      const about = await answer.json();
      // another process knows nothing of this page, and one that is still to come has a page of its own
      if (about.phase !== "running" || (crashes !== null && about.crashes > crashes)) return location.reload();
      if (crashes === null) {
        crashes = about.crashes;
        begin(about);
        if (crashes > Number(sessionStorage.getItem(noted) ?? crashes)) showNotice(`This session was interrupted: ${about.told}. What had been recorded before is lost.`);
        sessionStorage.setItem(noted, crashes);
      }
      if (viewers) viewers.textContent = about.viewers > 1 ? `${about.viewers} pages open` : "";
    } else if ((answer.status === 404 || answer.status === 403) && !gone) {
      gone = true; // said once
      showNotice("This link leads nowhere any more: it was taken back, or the server has begun anew. Ask for a new one.");
    }
  } catch { /* the server is away: viser's own page says so, and connects again */ }
  setTimeout(ask, 2000);
};
ask();
