// Numbers for people: round ticks, and units in which a value has few digits.

const SMALL = { // unit: [below this, times, becomes], the first that holds
  m: [[1e-3, 1e6, "µm"], [1, 1e3, "mm"]],
  N: [[0.1, 1e3, "mN"]],
  V: [[0.1, 1e3, "mV"]],
  s: [[1, 1e3, "ms"]],
  J: [[1e-3, 1e6, "µJ"], [1, 1e3, "mJ"]],
  "N*m": [[0.1, 1e3, "mN·m"]],
};

const POWERS = { 2: "²", 3: "³" }, PARTS = ["", "⁻³", "⁻⁶", "⁻⁹", "⁻¹²"], KNOWN = { 1: "", "1/s": "Hz" };

/** A number with its noun, which gets an s unless there is one. */
export const counted = (n, noun) => `${n} ${noun}${n === 1 ? "" : "s"}`;

/** A unit as it is printed: "N*s/m**2" is N·s/m². */
export const pretty = unit => KNOWN[unit] ?? unit.replace(/\*\*(\d)/g, (_, d) => POWERS[d] ?? `^${d}`).replaceAll("*", "·");

/** In what a signal of a unit is shown whose values reach up to `largest`: {factor, unit}. */
export function scaled(unit, largest) {
  for (const [below, factor, name] of SMALL[unit] ?? []) if (largest < below) return { factor, unit: name };
  const k = SMALL[unit] || !(largest > 0 && largest < 0.01) ? 0 : Math.min(4, Math.ceil(-Math.log10(largest) / 3));
  return { factor: 10 ** (3 * k), unit: k ? `×10${PARTS[k]} ${pretty(unit)}`.trim() : pretty(unit) };
}

/** Round numbers from low to high, about `count` of them and two at least, in steps of 1, 2 or 5 times a power of ten. */
export function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count), ten = 10 ** Math.floor(Math.log10(raw));
  const step = ten * ([1, 2, 5].find(k => k * ten >= raw * 0.999) ?? 10);
  const at = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) at.push(k * step);
  return at.length < 2 && high > low ? ticks(low, high, 2 * count) : { step, at }; // one number is no scale
}

/** A round number that is no less than x, and not much more. */
export function roundUp(x) {
  const ten = 10 ** Math.floor(Math.log10(x));
  return ten * ([1, 1.5, 2, 3, 4, 5, 6, 8].find(k => k * ten >= x * (1 - 1e-9)) ?? 10);
}

/** A number with the digits that a step needs, and a true minus sign. */
export function text(v, step) {
  const digits = Math.min(6, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)));
  return (Math.abs(v) < step * 1e-6 ? 0 : v).toFixed(digits).replace("-", "−");
}

/** A value with three digits, for labels: 0.0123 -> "0.0123", 1234.5 -> "1234". */
export function short(v) {
  if (!Number.isFinite(v)) return "–";
  const digits = v === 0 ? 0 : Math.min(4, Math.max(0, 2 - Math.floor(Math.log10(Math.abs(v)))));
  return Number(v.toFixed(digits)) === 0 ? "0" : v.toFixed(digits).replace("-", "−"); // not -0.0000
}
