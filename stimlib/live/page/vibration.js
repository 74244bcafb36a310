// What vibrates in outputs: a Butterworth high-pass of order 4.

export const EDGE = 40; // Hz above which something vibrates
export const DAMPED = [0.5412, 1.3066]; // Q of the two sections

const section = (c, q, n) => {
  const g = 1 / (1 + c / q + c * c);
  return { g, a: 2 * (c * c - 1) * g, b: (1 - c / q + c * c) * g, s: new Float64Array(n), t: new Float64Array(n) };
};

export class Vibration {
  /** Of n outputs at fs Hz. */
  constructor(fs, n) { this.sections = DAMPED.map(q => section(Math.tan(Math.PI * Math.min(EDGE, fs / 8) / fs), q, n)); }

  /** The high-pass of output k, in place; after a gap as if its first value had always been. */
  take(y, k, gap) {
    this.sections.forEach(({ g, a, b, s, t }, i) => {
      if (gap) { t[k] = i ? 0 : g * y[0]; s[k] = -t[k]; }
      for (let j = 0; j < y.length; j++) {
        const x = y[j], v = y[j] = g * x + s[k];
        s[k] = t[k] - 2 * g * x - a * v;
        t[k] = g * x - b * v;
      }
    });
  }
}
