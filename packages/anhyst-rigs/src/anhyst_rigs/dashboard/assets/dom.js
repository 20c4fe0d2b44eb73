// Creates elements in one call. Text is always text, never markup.

export function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

export function field(label, input, after = "") {
  return make("label", { className: "field" }, make("span", { textContent: label }), input, after);
}

export function select(names, chosen) {
  const element = make("select");
  for (const [value, text] of names) {
    element.append(make("option", { value, textContent: text, selected: value === chosen }));
  }
  return element;
}

// Disables a control and shows the reason as its title; without a reason, enables it and restores the title.
export function refuse(element, reason) {
  element.dataset.title ??= element.title;
  const title = reason || element.dataset.title;
  element.disabled = Boolean(reason);
  if (element.title !== title) element.title = title;
}

// Lets the browser download a file.
export function download(name, blob) {
  const link = make("a", { download: name, href: URL.createObjectURL(blob) });
  link.click();
  URL.revokeObjectURL(link.href);
}

// Stores the user's choices in the browser, for one rig if it is named. If the browser forbids storage,
// the choices are lost.
export function keeping(rig = "") {
  const key = (name) => ["anhyst", ...(rig ? [rig] : []), name].join(".");
  return {
    get(name, otherwise) {
      try {
        return JSON.parse(localStorage.getItem(key(name))) ?? otherwise;
      } catch {
        return otherwise;
      }
    },
    set(name, value) {
      try {
        localStorage.setItem(key(name), JSON.stringify(value));
      } catch {
        // forbidden in private windows
      }
    },
  };
}
