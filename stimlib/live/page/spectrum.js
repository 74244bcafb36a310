// Power spectral density of the newest samples: Hann window, mean taken out, one side (Welch 1967, with a mean that forgets).

/** In-place radix-2 FFT of `size` complex numbers. */
export function fft(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) { [re[i], re[j]] = [re[j], re[i]]; [im[i], im[j]] = [im[j], im[i]]; }
  }
  for (let len = 2; len <= n; len <<= 1) {
    const half = len >> 1, turn = -2 * Math.PI / len;
    for (let k = 0; k < half; k++) {
      const c = Math.cos(turn * k), s = Math.sin(turn * k);
      for (let i = k; i < n; i += len) {
        const j = i + half, a = re[j] * c - im[j] * s, b = re[j] * s + im[j] * c;
        re[j] = re[i] - a; im[j] = im[i] - b; re[i] += a; im[i] += b;
      }
    }
  }
}

/** Density of `x` (a power of two of samples at fs Hz) at k fs / n Hz, k = 0 .. n/2, in the square of its unit per Hz. */
export function density(x, fs) {
  const n = x.length, re = new Float64Array(n), im = new Float64Array(n), out = new Float64Array(n / 2 + 1);
  let mean = 0, power = 0;
  for (const v of x) mean += v / n;
  for (let i = 0; i < n; i++) {
    const w = 0.5 - 0.5 * Math.cos(2 * Math.PI * i / n);
    re[i] = w * (x[i] - mean);
    power += w * w;
  }
  fft(re, im);
  for (let k = 0; k <= n / 2; k++) out[k] = (re[k] ** 2 + im[k] ** 2) / (fs * power) * (k % (n / 2) ? 2 : 1);
  return out;
}

/** How many samples give lines about 2 Hz apart. */
export const lines = fs => 2 ** Math.round(Math.log2(fs / 2));

/** A mean of densities: the new one counts as the given share. */
export function smooth(mean, now, share) {
  if (mean?.length !== now.length) return now;
  for (let k = 0; k < now.length; k++) mean[k] += share * (now[k] - mean[k]);
  return mean;
}
