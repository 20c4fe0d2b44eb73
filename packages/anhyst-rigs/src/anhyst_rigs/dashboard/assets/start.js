// The page while a rig is built: polls the progress, and reloads when the rig responds.
//
// The server answers with title, work, share (0 to 1), seconds, error, and, if it knows them, the steps in their
// order: [{work, seconds}]. The last step runs; all others are done.

const POLL_INTERVAL_MS = 400;
const part = (id) => document.getElementById(id);

function show({ title, work, share, seconds, error, steps = [] }) {
  part("title").textContent = title;
  document.title = `${title} starts – anhyst live`;
  part("work").textContent = error ? "The start failed." : `${sentence(work)}: ${Math.round(100 * share)} %, ${Math.round(seconds)} s so far`;
  part("share").value = share;
  part("share").hidden = Boolean(error);
  part("error").textContent = error;
  part("error").hidden = !error;
  const known = steps.length ? steps : [{ work, seconds }];
  part("steps").replaceChildren(...known.map((step, n) => item(step, n + 1 === known.length, error)));
}

// Returns a list entry for a step with its mark and its time.
function item({ work, seconds }, isLast, error) {
  const entry = document.createElement("li");
  entry.dataset.state = isLast ? (error ? "failed" : "running") : "done";
  const mark = { done: "✓", running: "…", failed: "✗" }[entry.dataset.state];
  const time = document.createElement("output");
  time.textContent = `${seconds.toFixed(1)} s`;
  entry.append(`${mark} ${sentence(work)}`, time);
  return entry;
}

const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

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
