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

// Greys a control while it is refused, with the reason as its title; then it has its own title again.
export function refuse(element, reason) {
  element.dataset.title ??= element.title;
  element.disabled = Boolean(reason);
  element.title = reason || element.dataset.title;
}

// Hands a file to whoever looks at the page.
export function download(name, blob) {
  const link = make("a", { download: name, href: URL.createObjectURL(blob) });
  link.click();
  URL.revokeObjectURL(link.href);
}

// What a browser remembers of one's choices, of one rig where it is named; a browser that forbids
// it just forgets.
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
        // private windows
      }
    },
  };
}
