// A soft surface under its avatars, as stimlib.soft draws it: heights of Li et al. (2016), perspective at 45 degrees, shades.

const SKIN = [0.95, 0.84, 0.76], LIGHT = [-0.5, -0.5, 0.7071], TALL = 0.026, EYE = 4.563; // EYE: in diagonals, matplotlib's
export const BALLS = ["#2060c0", "#d03030", "#e8c020"];
const SIN = Math.SQRT1_2, FINE = 3; // parts of a cell, each way

const clamp = (k, n) => Math.min(n - 1, Math.max(0, k));

/** How far the surface is down at a distance rho from an indenter of radius r that is d deep; the node under it takes rho = 0. */
export function dent(rho, d, r) {
  if (!(d > 0)) return 0;
  if (rho === 0) return d;
  if (d <= (2 - Math.sqrt(3)) * r / 2) return 0;
  if (rho <= r) return Math.max(0, d - r + Math.sqrt(r * r - rho * rho));
  const reach = Math.max(d, 2 * r);
  return d > r ? Math.max(0, (d - r) * (reach - rho) / (reach - r)) : 0;
}

/** Nodes of a grid r/2 apart: {columns, rows, dx, dy, h}, h row by row from y = 0, not above 0 m; the mean where several reach. */
export function heights(avatars, width, height, r) {
  const spacing = r / 2, columns = Math.ceil(width / spacing - 1e-9) + 1, rows = Math.ceil(height / spacing - 1e-9) + 1;
  const dx = width / (columns - 1), dy = height / (rows - 1);
  const h = new Float64Array(columns * rows), reached = new Uint8Array(h.length);
  for (const { x, y, depth } of avatars) {
    const far = Math.max(depth, 2 * r);
    const i0 = clamp(Math.floor((x - far) / dx), columns), i1 = clamp(Math.ceil((x + far) / dx), columns);
    const j0 = clamp(Math.floor((y - far) / dy), rows), j1 = clamp(Math.ceil((y + far) / dy), rows);
    const ni = clamp(Math.round(x / dx), columns), nj = clamp(Math.round(y / dy), rows);
    const near = Math.hypot(ni * dx - x, nj * dy - y) <= spacing;
    for (let j = j0; j <= j1; j++)
      for (let i = i0; i <= i1; i++) {
        const down = dent(near && i === ni && j === nj ? 0 : Math.hypot(i * dx - x, j * dy - y), depth, r);
        if (down > 0) { h[j * columns + i] -= down; reached[j * columns + i]++; }
      }
  }
  for (let k = 0; k < h.length; k++) if (reached[k] > 1) h[k] /= reached[k];
  return { columns, rows, dx, dy, h };
}

/** What maps metres on the surface to pixels of a box and back: the eye looks down at 45 degrees from the side of y = 0. */
export function camera(width, height, left, top, wide, high) {
  const away = EYE * Math.hypot(width, height, TALL);
  const raw = (x, y, z) => {
    const forward = away + SIN * (y - height / 2) - SIN * z; // along the line of sight
    return [(x - width / 2) / forward, (SIN * (y - height / 2) + SIN * z) / forward, forward];
  };
  const [x0, y0] = raw(0, 0, 0), y1 = raw(0, height, 0)[1];
  const scale = Math.min(wide / (-2 * x0), high / (y1 - y0));
  const cx = left + wide / 2, cy = top + high / 2 + scale * (y1 + y0) / 2;
  return {
    to(x, y, z) { // third: pixels per metre
      const [u, v, f] = raw(x, y, z);
      return [cx + scale * u, cy - scale * v, scale / f];
    },
    from(px, py) { // where the line of sight meets z = 0
      const u = (px - cx) / scale, v = (cy - py) / scale, q = v * away / (SIN * (1 - v));
      return [width / 2 + u * (away + SIN * q), height / 2 + q];
    },
  };
}

/** How light a place of slopes (dh/dx, dh/dy) is, 0.25 to 1. */
export function shade(sx, sy) {
  const lit = (-sx * LIGHT[0] - sy * LIGHT[1] + LIGHT[2]) / Math.hypot(sx, sy, 1);
  return Math.min(1, 0.25 + 0.75 * Math.min(1, Math.max(0, lit)) / LIGHT[2]);
}

const colour = (light, hard = 0) => `rgb(${SKIN.map(c => Math.round(255 * light * c * (1 - 0.45 * hard))).join(" ")})`;

/** Between the values at the corners of a cell: lower left and right, upper left and right. */
const between = (z, u, v) => (z[0] * (1 - u) + z[1] * u) * (1 - v) + (z[2] * (1 - u) + z[3] * u) * v;

function quad(g, cam, x0, y0, x1, y1, z) {
  g.beginPath();
  g.moveTo(...cam.to(x0, y0, z[0]).slice(0, 2));
  g.lineTo(...cam.to(x1, y0, z[1]).slice(0, 2));
  g.lineTo(...cam.to(x1, y1, z[2]).slice(0, 2));
  g.lineTo(...cam.to(x0, y1, z[3]).slice(0, 2));
  g.closePath();
}

/** Slopes at the nodes, by central differences, and how light they are. */
function shades({ columns, rows, dx, dy, h }) {
  const at = (i, j) => h[clamp(j, rows) * columns + clamp(i, columns)];
  return (i, j) => shade((at(i + 1, j) - at(i - 1, j)) / (2 * dx), (at(i, j + 1) - at(i, j - 1)) / (2 * dy));
}

function cells(g, cam, grid, level) {
  const { columns, rows, dx, dy, h } = grid, light = shades(grid), flat = shade(0, 0);
  for (let j = rows - 2; j >= 0; j--) // from far to near
    for (let i = 0; i < columns - 1; i++) {
      const k = j * columns + i, z = [h[k], h[k + 1], h[k + columns], h[k + columns + 1]];
      const hard = level ? level((i + 0.5) * dx, (j + 0.5) * dy) : 0;
      const lit = [light(i, j), light(i + 1, j), light(i, j + 1), light(i + 1, j + 1)];
      if (hard < 0.02 && z.every(v => v === 0) && lit.every(v => v === flat)) continue; // painted already
      const fine = z.some(v => v !== 0) ? FINE : 1;
      for (let b = fine - 1; b >= 0; b--)
        for (let a = 0; a < fine; a++) {
          const u = [a / fine, (a + 1) / fine], v = [b / fine, (b + 1) / fine];
          g.fillStyle = g.strokeStyle = colour(between(lit, (u[0] + u[1]) / 2, (v[0] + v[1]) / 2), hard);
          quad(g, cam, (i + u[0]) * dx, (j + v[0]) * dy, (i + u[1]) * dx, (j + v[1]) * dy,
            [between(z, u[0], v[0]), between(z, u[1], v[0]), between(z, u[1], v[1]), between(z, u[0], v[1])]);
          g.fill();
          g.stroke(); // closes the hairlines between them
        }
    }
}

/** A ball that lies `depth` below the place (x, y) at z = 0. */
export function ball(g, cam, { x, y, depth }, r, paint) {
  const [px, py, scale] = cam.to(x, y, r - depth), size = r * scale;
  const glow = g.createRadialGradient(px - size / 3, py - size / 3, size / 8, px, py, size);
  glow.addColorStop(0, "#fff");
  glow.addColorStop(0.35, paint);
  glow.addColorStop(1, paint);
  g.fillStyle = glow;
  g.beginPath();
  g.arc(px, py, size, 0, 2 * Math.PI);
  g.fill();
}

/** The level of a map at a place: {width, height, rows, columns, levels}, the first row at y = 0. */
export function levelAt({ width, height, rows, columns, levels }) {
  return (x, y) => levels[Math.round(y / height * (rows - 1)) * columns + Math.round(x / width * (columns - 1))] ?? 0;
}

/** Draws the surface and the balls (surface, cursor: whether); `level`, if given, darkens what is hard. */
export function draw(g, cam, avatars, width, height, r, level, { surface, cursor }) {
  if (surface) {
    g.lineWidth = 0.75;
    g.fillStyle = colour(1);
    quad(g, cam, 0, 0, width, height, [0, 0, 0, 0]);
    g.fill();
    cells(g, cam, heights(avatars, width, height, r), level);
  }
  if (cursor) avatars.forEach((a, i) => ball(g, cam, a, r, BALLS[i % BALLS.length]));
}
