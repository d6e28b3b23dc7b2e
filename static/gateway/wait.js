// The page of a session that does not run yet: asks how it stands, and goes on by itself.
const show = (id) => { for (const part of document.querySelectorAll("[data-phase]")) part.hidden = part.dataset.phase !== id; };
const sentence = (text) => text ? text[0].toUpperCase() + text.slice(1) + "." : "";
const ask = async () => {
  try {
    const answer = await fetch("about?wait", { cache: "no-store" });
    if (answer.status === 403 || answer.status === 404) return location.reload();
    const { phase, place, full, why, told, rest } = await answer.json();
    if (phase === "running") return location.reload();
    show(full ? "full" : place > 0 ? "waiting" : phase === "failed" ? "failed" : "starting");
    document.getElementById("place").textContent = place;
    document.getElementById("rest").textContent = rest;
    document.getElementById("why").textContent = sentence(why);
    document.getElementById("notice").textContent = sentence(told);
  } catch { show("lost"); }
  setTimeout(ask, 1000);
};
document.getElementById("again").hidden = location.pathname.includes("/watch/");  // who watches begins nothing
document.getElementById("again").addEventListener("click", async () => {
  try { await fetch("again", { method: "POST" }); } catch { show("lost"); }
});
ask();
