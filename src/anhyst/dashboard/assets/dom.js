// Elements, made in one call; text is always text, never markup.

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

// What a browser remembers of one's choices; a browser that forbids it just forgets.
export const kept = {
  get(name, otherwise) {
    try {
      return JSON.parse(localStorage.getItem(`anhyst.${name}`)) ?? otherwise;
    } catch {
      return otherwise;
    }
  },
  set(name, value) {
    try {
      localStorage.setItem(`anhyst.${name}`, JSON.stringify(value));
    } catch {
      // private windows
    }
  },
};
