// What is drawn of a scene, on the live page and on that of an experiment, by the kind of its view. protocol.py has the views.

import { BALLS, ball, camera, draw as drawSurface, levelAt } from "./surface.js";

const RADIUS = 0.005, PLATE = "#e8c020", COIL = "#1597b0", FLOOR = "#8793a1"; // m, of an avatar; yellow and cyan of Çaldıran's figure 3.2
const TURNS = 7, THICK = 14, POINT = 9; // of the helix; px of the plate, and of what presses it

/** `fit` places a view in so many px; `draw` draws it there: its values (null: no stimulus now), and the parts that are wanted. */
export const pictures = {
  surface: {
    fit: ({ width, height }, wide, high) => camera(width, height, 12, 12, wide - 24, high - 24),
    draw(g, cam, view, values, parts) {
      const of = name => (Number.isFinite(values[name]) ? values[name] : 0);
      const avatars = values ? view.avatars.map(a => ({ x: of(a.x), y: of(a.y), depth: of(a.depth) })) : [];
      const paint = now => drawSurface(g, cam, avatars, view.width, view.height, RADIUS, parts.hidden && view.levels && levelAt(view), now);
      paint({ surface: parts.surface });
      Object.assign(g, { fillStyle: BALLS[0], font: "16px system-ui, sans-serif", textBaseline: "middle" });
      for (const [name, [x, y]] of Object.entries(parts.marks ?? {})) {
        const [px, py] = cam.to(x, y, 0);
        g.beginPath();
        g.arc(px, py, 4, 0, 2 * Math.PI);
        g.fill();
        g.fillText(name, px + 9, py);
      }
      paint({ cursor: parts.cursor });
    },
  },
  plate: {
    fit: ({ length }, wide, high) => ({ x: wide / 2, base: high - 16, scale: (high - 50) / (1.3 * length), half: Math.min(140, wide / 2 - 16) }),
    draw(g, { x, base, scale, half }, { length, values: [name] }, values, parts) {
      const pressed = Math.max(-0.2 * length, Math.min(values?.[name] ?? 0, 0.95 * length));
      const top = base - scale * (length - Math.max(0, pressed)), steps = 36 * TURNS, round = 0.35 * (base - top) / TURNS;
      if (parts.surface) {
        Object.assign(g, { lineWidth: 5, lineJoin: "round", strokeStyle: COIL });
        g.beginPath();
        for (let k = 0; k <= steps; k++) {
          const turn = Math.PI * k / 18;
          g.lineTo(x + 0.6 * half * Math.cos(turn), base + (top - base) * k / steps + round * Math.sin(turn));
        }
        g.stroke();
        g.fillStyle = PLATE;
        g.fillRect(x - half, top - THICK, 2 * half, THICK);
        g.fillStyle = FLOOR;
        g.fillRect(x - half, base + 5, 2 * half, 4);
      }
      const at = [x, base - scale * (length - pressed) - THICK - POINT, 1];
      if (parts.cursor && values) ball(g, { to: () => at }, { depth: 0 }, POINT, BALLS[0]);
    },
  },
};
