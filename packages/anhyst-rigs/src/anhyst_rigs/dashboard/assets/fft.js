// Computes the amplitude spectral density of consecutive samples.

// Window functions over an interval from 0 to 1.
export const WINDOWS = {
  Hann: (part) => 0.5 - 0.5 * Math.cos(2 * Math.PI * part),
  "flat top": (part) =>
    0.21557895 -
    0.41663158 * Math.cos(2 * Math.PI * part) +
    0.277263158 * Math.cos(4 * Math.PI * part) -
    0.083578947 * Math.cos(6 * Math.PI * part) +
    0.006947368 * Math.cos(8 * Math.PI * part),
  none: () => 1,
};

// Transforms in place; the number of samples must be a power of two.
export function transform(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [re[i], re[j]] = [re[j], re[i]];
      [im[i], im[j]] = [im[j], im[i]];
    }
  }
  for (let half = 1; half < n; half <<= 1) {
    for (let k = 0; k < half; k++) {
      const c = Math.cos((Math.PI * k) / half);
      const s = -Math.sin((Math.PI * k) / half);
      for (let i = k; i < n; i += 2 * half) {
        const j = i + half;
        const x = re[j] * c - im[j] * s;
        const y = re[j] * s + im[j] * c;
        re[j] = re[i] - x;
        im[j] = im[i] - y;
        re[i] += x;
        im[i] += y;
      }
    }
  }
}

// Welch's method: segments of `length` samples overlap by half, and the mean of each is removed.
// Returns the frequencies in Hz and the one-sided density without 0 Hz, in the samples' unit per root Hz.
export function density(samples, rate, length, shape) {
  const weights = Float64Array.from({ length }, (_, i) => shape(i / length));
  const power = weights.reduce((sum, one) => sum + one * one, 0);
  const sums = new Float64Array(length / 2 + 1);
  let count = 0;
  for (let first = 0; first + length <= samples.length; first += length / 2, count++) {
    let mean = 0;
    for (let i = 0; i < length; i++) mean += samples[first + i] / length;
    const re = Float64Array.from(weights, (one, i) => one * (samples[first + i] - mean));
    const im = new Float64Array(length);
    transform(re, im);
    for (let k = 1; k < sums.length; k++) sums[k] += re[k] * re[k] + im[k] * im[k];
  }
  const frequencies = [];
  const densities = [];
  for (let k = 1; k < sums.length; k++) {
    const sides = k === length / 2 ? 1 : 2;
    frequencies.push((k * rate) / length);
    densities.push(Math.sqrt((sides * sums[k]) / (count * rate * power)));
  }
  return { frequencies, densities };
}
