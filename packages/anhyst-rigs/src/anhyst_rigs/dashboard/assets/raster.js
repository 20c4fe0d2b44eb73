// Draws traces pixel by pixel. This is ten times faster than thousands of short strokes of a canvas.

const MIN_STEEP_PX = 4; // smallest height of a column that is drawn without dashes, pixels

export class Raster {
  canvas = document.createElement("canvas");
  #context = this.canvas.getContext("2d");
  #image = null;
  #pixels = null;
  #width = 0;
  #height = 0;

  // Starts an empty picture.
  begin(width, height) {
    if (this.#width !== width || this.#height !== height) {
      this.canvas.width = this.#width = width;
      this.canvas.height = this.#height = height;
      this.#image = this.#context.createImageData(width, height);
      this.#pixels = new Uint32Array(this.#image.data.buffer);
    } else {
      this.#pixels.fill(0);
    }
  }

  // Draws a line through points: x = a[0] * value + a[1] from the left, y = b[0] * value + b[1] from
  // the top, in pixels. The line is interrupted at values that are NaN. Dashes: [period, drawn part], pixels.
  line(xs, ys, a, b, { colour, dash, alpha }, thickness) {
    this.pen = { paint: word(colour, alpha), dash, thickness };
    let left = NaN;
    let before = NaN;
    let [column, top, bottom] = [NaN, NaN, NaN]; // the pixel column that is not drawn yet, and its extent
    for (let i = 0; i < xs.length; i++) {
      const x = a[0] * xs[i] + a[1];
      const y = b[0] * ys[i] + b[1];
      const here = Math.floor(x);
      const joined = left <= x && before === before && y === y;
      if (joined && here === column) {
        if (y < top) top = y;
        if (y > bottom) bottom = y;
      } else {
        if (joined) {
          const slope = (y - before) / (x - left);
          const edge = before + slope * (column + 1 - left);
          this.#column(column, Math.min(top, edge), Math.max(bottom, edge));
          this.#slope(column + 1, here, edge, slope);
          const entry = y - slope * (x - here);
          [column, top, bottom] = [here, Math.min(entry, y), Math.max(entry, y)];
        } else {
          this.#column(column, top, bottom);
          [column, top, bottom] = [here, y, y];
        }
      }
      left = x;
      before = y;
    }
    this.#column(column, top, bottom);
  }

  // Returns the picture as a canvas.
  end() {
    this.#context.putImageData(this.#image, 0, 0);
    return this.canvas;
  }

  // Draws the columns of a straight part, from its height at the left edge of the first column.
  #slope(first, end, height, slope) {
    for (let x = Math.max(first, 0); x < Math.min(end, this.#width); x++) {
      const from = height + slope * (x - first);
      this.#column(x, Math.min(from, from + slope), Math.max(from, from + slope));
    }
  }

  // Draws a column; nothing if it is outside the picture or has no extent.
  #column(x, top, bottom) {
    const width = this.#width;
    const { paint, dash, thickness } = this.pen;
    if (!(x >= 0 && x < width && top <= bottom)) return;
    // Steep parts have no dashes, so that no spike is lost.
    if (dash && bottom - top < MIN_STEEP_PX && x % dash[0] >= dash[1]) return;
    const first = Math.max(0, Math.round(top - 0.5 * thickness));
    const last = Math.min(this.#height, Math.max(first + thickness, Math.round(bottom + 0.5 * thickness)));
    const pixels = this.#pixels;
    for (let at = first * width + x, end = last * width; at < end; at += width) pixels[at] = paint;
  }
}

// Returns the 32-bit word of a pixel with the colour #rrggbb; bytes are in the order RGBA.
function word(colour, alpha) {
  const rgb = Number.parseInt(colour.slice(1), 16);
  const bytes = new Uint8Array([rgb >> 16, (rgb >> 8) & 255, rgb & 255, Math.round(255 * alpha)]);
  return new Uint32Array(bytes.buffer)[0];
}
