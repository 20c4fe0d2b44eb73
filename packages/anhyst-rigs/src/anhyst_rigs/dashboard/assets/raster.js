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
    const paint = word(colour, alpha);
    this.dash = dash;
    let left = NaN;
    let before = NaN;
    for (let i = 0; i < xs.length; i++) {
      const x = a[0] * xs[i] + a[1];
      const y = b[0] * ys[i] + b[1];
      if (left <= x && before === before && y === y)
        this.#segment(left, before, x, y, paint, thickness);
      left = x;
      before = y;
    }
  }

  // Returns the picture as a canvas.
  end() {
    this.#context.putImageData(this.#image, 0, 0);
    return this.canvas;
  }

  #segment(x0, y0, x1, y1, paint, thickness) {
    const first = Math.floor(x0);
    const last = Math.floor(x1);
    if (first === last) {
      this.#column(first, Math.min(y0, y1), Math.max(y0, y1), paint, thickness);
      return;
    }
    const slope = (y1 - y0) / (x1 - x0);
    const end = Math.min(last, this.#width - 1);
    for (let x = Math.max(first, 0); x <= end; x++) {
      const from = y0 + slope * (Math.max(x, x0) - x0);
      const to = y0 + slope * (Math.min(x + 1, x1) - x0);
      this.#column(x, Math.min(from, to), Math.max(from, to), paint, thickness);
    }
  }

  #column(x, top, bottom, paint, thickness) {
    const width = this.#width;
    if (x < 0 || x >= width) return;
    // Steep parts have no dashes, so that no spike is lost.
    if (this.dash && bottom - top < MIN_STEEP_PX && x % this.dash[0] >= this.dash[1]) return;
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
