// What vibrates in outputs: a Butterworth high-pass of order 4.

export const EDGE = 40; // Hz above which something vibrates
export const DAMPED = [0.5412, 1.3066]; // Q of the two sections
const SETTLES = 0.1; // s after a gap in which the filter answers to the gap

const section = (c, q, n) => {
  const g = 1 / (1 + c / q + c * c);
  return { g, a: 2 * (c * c - 1) * g, b: (1 - c / q + c * c) * g, s: new Float64Array(n), t: new Float64Array(n) };
};

export class Vibration {
  /** Of n outputs at fs Hz. */
  constructor(fs, n) {
    Object.assign(this, { settles: Math.round(SETTLES * fs), left: new Int32Array(n) });
    this.sections = DAMPED.map(q => section(Math.tan(Math.PI * Math.min(EDGE, fs / 8) / fs), q, n));
  }

  /** The high-pass of output k, in place; after a gap as if its first value had always been, and nothing until that has settled, if lost. */
  take(y, k, gap, lost = false) {
    if (gap) this.left[k] = lost ? this.settles : 0;
    this.sections.forEach(({ g, a, b, s, t }, i) => {
      if (gap) { t[k] = i ? 0 : g * y[0]; s[k] = -t[k]; }
      for (let j = 0; j < y.length; j++) {
        const x = y[j], v = y[j] = g * x + s[k];
        s[k] = t[k] - 2 * g * x - a * v;
        t[k] = g * x - b * v;
      }
    });
    const left = Math.min(this.left[k], y.length);
    y.fill(NaN, 0, left);
    this.left[k] -= left;
  }
}
