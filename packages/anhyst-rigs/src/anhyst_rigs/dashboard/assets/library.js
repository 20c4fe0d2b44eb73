// The finished recordings in the folder of the bench: a menu that overlays one, and a list of links that save them.

import { make } from "./dom.js";

const MAX_OVERLAID_BYTES = 200e6;

// Returns the menu that draws a recording of the bench, or a file of this computer, behind the running signals:
// `overlay` receives the file, `notify` a reason. After a change of the list, call its method `list`.
export function overlayMenu(bench, overlay, notify) {
  const file = make("input", { type: "file", accept: ".csv,.mf4", hidden: true, id: "overlay-file" });
  file.onchange = () => {
    if (file.files[0]) overlay(file.files[0]);
    file.value = "";
  };
  const menu = make("select", { id: "overlay", title: "Draw a recording behind the running signals; a file (.csv or .mf4) can also be dropped on a plot" });
  menu.ariaLabel = "overlay a recording";
  menu.onchange = () => {
    const chosen = bench.recordings.find(({ name }) => name === menu.value);
    if (menu.value === "file") file.click();
    else if (chosen) fetchRecording(bench, chosen).then(overlay, (wrong) => notify(`${chosen.name}: ${wrong.message}`));
    menu.value = "";
  };
  const entry = (value, textContent) => make("option", { value, textContent });
  const list = () =>
    menu.replaceChildren(
      entry("", "Overlay…"),
      ...bench.recordings.map((one) => entry(one.name, `${one.name}, ${when(one)}`)),
      entry("file", "A file of this computer…"),
    );
  list();
  return { elements: [menu, file], list };
}

// Returns the list of the recordings with a link that saves each; call its method `list` after a change.
export function downloadList(bench) {
  const title = make("summary");
  const links = make("ul");
  const element = make("details", { id: "recordings" }, title, links);
  const list = () => {
    const { recordings } = bench;
    element.hidden = !recordings.length;
    title.textContent = `Recordings (${recordings.length})`;
    links.replaceChildren(
      ...recordings.map((one) => {
        const link = make("a", { href: addressOf(bench, one), download: one.name, textContent: one.name, title: `Save ${one.name}` });
        return make("li", {}, link, ` ${size(one)}, ${when(one)}`);
      }),
    );
  };
  list();
  return { element, list };
}

const addressOf = (bench, { name }) => bench.downloads + encodeURIComponent(name);

// Loads a recording from the server as a file.
async function fetchRecording(bench, recording) {
  if (recording.size_bytes > MAX_OVERLAID_BYTES)
    throw new Error(`has ${size(recording)}, but at most ${MAX_OVERLAID_BYTES / 1e6} MB can be drawn; save it, or record a shorter time`);
  const answer = await fetch(addressOf(bench, recording));
  if (!answer.ok) throw new Error("is no longer in the folder");
  return new File([await answer.blob()], recording.name);
}

// Returns the size of a recording, such as 1.3 MB.
function size({ size_bytes: bytes }) {
  return bytes < 1e5 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

// Returns the local time of a recording; for another day than today, the date.
function when({ modified_s: time }) {
  const date = new Date(1e3 * time);
  const today = date.toDateString() === new Date().toDateString();
  return today ? date.toLocaleTimeString() : date.toLocaleDateString();
}
