// The page while a rig is built: polls the progress, and reloads when the rig responds.

const POLL_INTERVAL_MS = 400;
const part = (id) => document.getElementById(id);

function show({ title, work, share, seconds, error }) {
  part("title").textContent = title;
  part("work").textContent = error ? "The start failed." : `${work}: ${Math.round(100 * share)} %, ${Math.round(seconds)} s so far`;
  part("share").value = share;
  part("share").hidden = Boolean(error);
  part("error").textContent = error;
  part("error").hidden = !error;
}

async function ask() {
  try {
    const reply = await fetch("/start", { cache: "no-store" });
    if (reply.status === 404) {
      location.reload(); // the rig runs, and its server does not know this address
      return;
    }
    const start = await reply.json();
    show(start);
    if (start.error) return;
  } catch {
    part("work").textContent = "No answer. Is anhyst live still running?";
  }
  setTimeout(ask, POLL_INTERVAL_MS);
}

ask();
