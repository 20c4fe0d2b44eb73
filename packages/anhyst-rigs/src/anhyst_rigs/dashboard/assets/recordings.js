// Reads the recordings that the server writes: CSV, and MDF 4.1 with one channel group of 64-bit floats.

// Returns the ticks, their times, and the columns of a CSV by their headers; lines that start with # are notes.
export function readCsv(text) {
  const lines = text.split("\n").filter((line) => line && !line.startsWith("#"));
  const heads = (lines.shift() ?? "").trim().split(",");
  if (heads[0] !== "tick") throw new Error("is not a recording: its first column is not 'tick'");
  const columns = heads.map((_, n) => new (n === 1 ? Float64Array : Float32Array)(lines.length)); // times need all digits
  const ticks = new Float64Array(lines.length);
  for (const [row, line] of lines.entries()) {
    const cells = line.split(",");
    ticks[row] = Number(cells[0]);
    for (let n = 1; n < heads.length; n++) columns[n][row] = Number(cells[n]);
  }
  return { ticks, times: columns[1], columns: new Map(heads.map((head, n) => [head, columns[n]])) };
}

const HEADER_BYTES = 24; // length of the header of an MDF block
const FIRST_BLOCK = 64; // address of the first block

// Returns the ticks, their times, the columns of an MDF file by their channel names, and the units of the channels.
export function readMdf(buffer) {
  const view = new DataView(buffer);
  const number = (address) => Number(view.getBigUint64(address, true));
  const text = (address, length) => new TextDecoder().decode(new Uint8Array(buffer, address, length));
  const link = (block, n) => number(block + HEADER_BYTES + 8 * n);
  const is = (block, name) => text(block, 4) === `##${name}`;
  if (text(0, 3) !== "MDF" || !is(FIRST_BLOCK, "HD")) throw new Error("is not an MDF 4 file");
  const group = link(FIRST_BLOCK, 0);
  const channels = link(group, 1);
  const textOf = (block) => (block ? text(block + HEADER_BYTES, number(block + 8) - HEADER_BYTES).replace(/\0[^]*$/, "") : "");
  const names = [];
  const units = new Map();
  for (let channel = link(channels, 1); channel; channel = link(channel, 0)) {
    names.push(textOf(link(channel, 2)));
    units.set(names.at(-1), textOf(link(channel, 6)));
  }
  if (names[1] !== "tick") throw new Error("is not a recording of this program");
  const blocks = [];
  for (let list = link(group, 2); list; list = link(list, 0)) blocks.push(link(list, 1));
  const width = 8 * names.length;
  const sizes = blocks.map((block) => Math.floor((number(block + 8) - HEADER_BYTES) / width));
  const count = sizes.reduce((sum, one) => sum + one, 0);
  const ticks = new Float64Array(count);
  const columns = names.map((_, n) => new (n === 0 ? Float64Array : Float32Array)(count)); // times need all digits
  let row = 0;
  for (const [n, block] of blocks.entries()) {
    for (let i = 0; i < sizes[n]; i++, row++) {
      const at = block + HEADER_BYTES + i * width;
      ticks[row] = view.getFloat64(at + 8, true);
      columns[0][row] = view.getFloat64(at, true);
      for (let c = 2; c < names.length; c++) columns[c][row] = view.getFloat64(at + 8 * c, true);
    }
  }
  return { ticks, times: columns[0], columns: new Map(names.map((name, n) => [name, columns[n]])), units };
}
