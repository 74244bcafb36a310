// Curves that are drawn where they are new: the lowest and highest sample of each column of pixels, and a picture of columns.

const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3], [], [6, 3]]; // so that colour is not the only difference

/** Lowest and highest of a signal in bins of `per` samples: the newest as many as there are columns, bin b at b % columns. */
export class Envelope {
  constructor(columns, per) {
    const filled = v => new Float32Array(columns).fill(v);
    Object.assign(this, { columns, per, end: 0, low: filled(Infinity), high: filled(-Infinity) });
    this.along = new Float64Array(columns); // pixels of line before a bin
  }

  /** Takes the samples of a ring up to number `end`; the first bin that is not as it was. Bins are absolute: none flickers. */
  take(ring, end) {
    const { columns, per, low, high } = this, size = ring.length, newest = Math.floor((end - 1) / per);
    const first = Math.max(0, newest - columns + 1, Math.floor(this.end / per));
    for (let b = first; b <= newest; b++) {
      let least = Infinity, most = -Infinity;
      const stop = Math.min(end, Math.ceil((b + 1) * per));
      for (let k = Math.max(0, end - size, Math.ceil(b * per)); k < stop; k++) {
        const v = ring[k % size];
        if (v < least) least = v;
        if (v > most) most = v;
      }
      low[b % columns] = least;
      high[b % columns] = most;
    }
    this.end = end;
    return first;
  }
}

/** A picture of envelopes. With a pixel for each bin it is a ring as they are, and what stays is not drawn again. */
export class Strip {
  constructor() { this.g = document.createElement("canvas").getContext("2d"); }

  /** An empty picture of `columns` bins, `ratio` pixels to one of css. */
  clear(columns, wide, high, ratio) {
    Object.assign(this, { columns, wide, high, ratio, step: wide / columns });
    Object.assign(this.g.canvas, { width: wide, height: high });
  }

  /** Bins `first` .. `newest` are new; y(v) is the pixel of a value. */
  draw(curves, first, newest, y, paints) {
    const { g, columns, step, high, ratio } = this, back = Math.ceil(3 * ratio); // what a line's width and joins reach
    const oldest = Math.max(0, newest - columns + 1), from = step === 1 ? Math.max(oldest, first - back) : oldest;
    this.head = step === 1 ? (newest + 1) % columns : 0; // where the oldest column is
    for (let b = step === 1 ? from - from % columns : newest + 1 - columns; b <= newest; b += columns) { // b: the bin at the left
      const left = Math.max(from, b), right = Math.min(newest + 1, b + columns);
      g.save();
      g.beginPath();
      g.rect((left - b) * step, 0, (right - left) * step, high);
      g.clip();
      g.clearRect(0, 0, this.wide, high);
      g.lineWidth = 1.5 * ratio;
      g.lineJoin = "round";
      curves.forEach((curve, i) => {
        g.strokeStyle = paints[i % 6];
        g.setLineDash(DASHES[i % 6].map(d => d * ratio));
        trace(g, curve, Math.max(oldest, left - back), Math.min(newest, right + back), k => (k - b + 0.5) * step, y);
      });
      g.restore();
    }
  }

  /** The oldest column at x, in pixels of g's canvas. */
  show(g, x, y) {
    const { wide, high, head } = this, { canvas } = this.g;
    g.drawImage(canvas, head, 0, wide - head, high, x, y, wide - head, high);
    if (head) g.drawImage(canvas, 0, 0, head, high, x + wide - head, y, head, high);
  }
}

/** Bins start .. stop. How long the line is up to a bin is kept, so that dashes go on where they were. */
function trace(g, { columns, low, high, along }, start, stop, x, y) {
  let down = false, at = 0, last = 0;
  g.beginPath();
  for (let b = start; b <= stop; b++) {
    const i = b % columns, here = x(b), foot = y(low[i]), top = y(high[i]);
    if (!(low[i] <= high[i])) { down = false; continue; } // a gap
    if (down) {
      at += Math.hypot(here - x(b - 1), foot - last);
      g.lineTo(here, foot);
    } else {
      g.stroke();
      g.beginPath();
      g.lineDashOffset = at = b === start ? along[i] : 0;
      g.moveTo(here, foot);
    }
    along[i] = at;
    at += foot - top;
    if (foot > top) g.lineTo(here, top);
    last = top;
    down = true;
  }
  g.stroke();
}
