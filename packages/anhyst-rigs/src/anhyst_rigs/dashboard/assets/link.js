// The WebSocket: receives frames of samples and messages, and sends orders.

const HEAD_BYTES = 24;

// Decodes a frame (browsers.py): its first and last tick, the tick of each row, one column per signal.
export function decode(buffer) {
  const view = new DataView(buffer);
  const rows = view.getUint32(0, true);
  const columns = view.getUint32(4, true);
  const data = [];
  let at = HEAD_BYTES + 8 * rows;
  for (let n = 0; n < columns; n++, at += 4 * rows) data.push(new Float32Array(buffer, at, rows));
  return {
    first: view.getFloat64(8, true),
    last: view.getFloat64(16, true),
    ticks: new Float64Array(buffer, HEAD_BYTES, rows),
    data,
    thinned: view.getUint32(at, true) !== 0,
  };
}

export class Link extends EventTarget {
  #socket = null;
  #next = 1;
  #waiting = new Map();
  #askToken;

  constructor(askToken) {
    super();
    this.#askToken = askToken;
    this.#open();
  }

  // Sends an order; the promise gives the answer, or fails with the reason.
  order(what, fields = {}) {
    if (this.#socket?.readyState !== WebSocket.OPEN)
      return Promise.reject(new Error("not connected"));
    const id = this.#next++;
    this.#socket.send(JSON.stringify({ do: what, id, ...fields }));
    return new Promise((resolve, reject) => this.#waiting.set(id, { resolve, reject }));
  }

  #open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.#read(event.data);
    socket.onclose = (event) => this.#lost(event);
    this.#socket = socket;
  }

  async #read(data) {
    if (data instanceof ArrayBuffer) {
      this.#say("frame", decode(data));
      return;
    }
    const message = JSON.parse(data);
    if (message.kind === "token") {
      this.#socket.send(JSON.stringify({ token: await this.#askToken() }));
    } else if (message.kind === "answer") {
      this.#answer(message);
    } else {
      this.#say(message.kind, message);
    }
  }

  #answer(message) {
    const order = this.#waiting.get(message.id);
    this.#waiting.delete(message.id);
    if (message.reason) order?.reject(new Error(message.reason));
    else order?.resolve(message);
  }

  #lost(event) {
    for (const { reject } of this.#waiting.values()) reject(new Error("connection lost"));
    this.#waiting.clear();
    this.#say("lost", event.reason);
    setTimeout(() => this.#open(), 1000);
  }

  #say(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }
}
