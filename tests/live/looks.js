// What test_browser.py asks of a page that it has open: how things look, and what is heard.
window.looks = {
  /** The least contrast of any text with what is behind it, after WCAG 2, and where: [ratio, element]. */
  contrast() {
    const numbers = c => c.match(/[\d.]+/g).map(Number);
    const linear = v => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
    const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
    const behind = e => {
      for (; e; e = e.parentElement) {
        const [r, g, b, a = 1] = numbers(getComputedStyle(e).backgroundColor);
        if (a) return [r, g, b];
      }
      return [255, 255, 255];
    };
    const ratio = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    let least = [99, ""];
    for (const e of document.querySelectorAll("body *")) {
      const text = [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()) || e.matches("input.number, select");
      if (!text || !e.checkVisibility() || e.matches("option, noscript")) continue;
      const found = ratio(light(numbers(getComputedStyle(e).color)), light(behind(e)));
      if (found < least[0]) least = [found, e.outerHTML.slice(0, 100)];
    }
    return least;
  },

  /** Contrast of the colours on canvases with the panel: of text, and of curves. */
  async painted() {
    const numbers = c => c.match(/[\d.]+/g).map(Number), { palette } = await import("./plots.js"), p = palette();
    const linear = v => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
    const light = c => (([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b))(numbers(c));
    const ratio = c => (Math.max(light(c), light(p.panel)) + 0.05) / (Math.min(light(c), light(p.panel)) + 0.05);
    return { text: Math.min(ratio(p.ink), ratio(p.soft)), curves: Math.min(...p.curves.map(ratio)) };
  },

  /** Rows of the newest columns in which a panel's first curve is, and the row where `value` is. */
  async curve(name, value) {
    const { live } = await import("./live.js"), p = live.panels.find(q => q.signals[0].name === name), c = p.canvas;
    const all = c.getContext("2d").getImageData(c.width - 14, 0, 1, c.height).data, rows = [...Array(c.height).keys()];
    const blue = rows.filter(k => all[4 * k + 2] - all[4 * k] > 60), high = c.height - 28;
    return { blue, at: 8 + high * (p.top - value) / (p.top - p.bottom) };
  },

  /** Of the panel of what vibrates in an output: columns with a curve, and the height of the curve of that of the canvas. */
  async vibrates(name) {
    const { live } = await import("./live.js"), { canvas: c } = live.panels.find(p => p.signals[0].name === name && p.signals[0].least);
    c.scrollIntoView({ block: "center" });
    await new Promise(done => setTimeout(done, 200)); // until it is drawn
    const { data } = c.getContext("2d").getImageData(0, 0, c.width, c.height), rows = [], columns = new Set();
    for (let k = 0; k < data.length; k += 4)
      if (data[k + 2] - data[k] > 60) { rows.push(Math.floor(k / 4 / c.width)); columns.add(k / 4 % c.width); }
    return { columns: columns.size, high: (rows.at(-1) - rows[0]) / c.height };
  },

  /** A panel that is drawn in steps of `step` samples beside one that is drawn once: largest difference of a pixel, and how many
      columns have a curve. Signal i is a sine, without samples 200 .. 299. */
  async grown(signals, samples, fs, step) {
    const { History, Panel, palette } = await import("./plots.js"), colours = palette();
    const parent = document.querySelector("#outputs");
    const all = [...Array(signals).keys()], history = new History(10 * fs, all.map(() => 1));
    const made = () => new Panel(all.map(index => ({ index, name: `y${index}`, unit: "V" })), history, parent);
    const grown = made();
    for (let k = 0; k < samples; k += step) {
      const y = all.flatMap(i => Array.from({ length: step }, (_, j) => 0.9 * Math.sin((k + j) / (30 - 13 * i))));
      if (k < 200 || k >= 300) history.push(k, step, y);
      grown.draw(fs, 1, colours, false);
    }
    const once = made();
    once.draw(fs, 1, colours, false);
    const [a, b] = [grown, once].map(({ canvas: c }) => c.getContext("2d").getImageData(0, 0, c.width, c.height));
    const ink = ({ data }, k) => (k % 4 < 3 ? data[k] * data[k | 3] / 255 : data[k]); // colours of faint pixels say little
    const edge = k => (k >> 2) % a.width < 61; // where the window cuts a line
    const worst = a.data.reduce((most, _, k) => (edge(k) ? most : Math.max(most, Math.abs(ink(a, k) - ink(b, k)))), 0);
    const seen = new Set();
    for (let k = 0; k < a.data.length; k += 4) if (a.data[k + 2] - a.data[k] > 60) seen.add(k / 4 % a.width);
    for (const p of [grown, once]) p.root.remove();
    return { worst, columns: seen.size, wide: a.width - 68 };
  },

  /** The middle of what is blue in the field, across. */
  ball() {
    const c = document.querySelector("#field"), all = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
    let n = 0, x = 0;
    for (let k = 0; k < all.length; k += 4) if (all[k + 2] - all[k] > 100) { n++; x += k / 4 % c.width; }
    return n > 100 && x / n;
  },

  /** Listens to the audio thread's node; `rms` is that of the last 0.7 s. */
  async listen() {
    const { live } = await import("./live.js"), { node, context } = live.sound;
    const heard = new AnalyserNode(context, { fftSize: 32768 });
    node.connect(heard);
    looks.rms = () => {
      const y = new Float32Array(32768);
      heard.getFloatTimeDomainData(y);
      return Math.sqrt(y.reduce((a, b) => a + b * b, 0) / y.length);
    };
  },
};
