// The model, evaluated where it is looked at: superquadrics, the box of control points that carries them, splines
// over time. The same formulas as the Python package; numbers in brackets are the paper's equations.

const TINY = 1e-300;
const logAbs = (u) => Math.log(Math.max(Math.abs(u), TINY));

/** Radius of (u, v) in units of a superellipse (P10). */
function norm(u, v, exponent) {
  const k = 2 / exponent, a = k * logAbs(u), b = k * logAbs(v);
  return Math.exp((Math.max(a, b) + Math.log1p(Math.exp(-Math.abs(a - b)))) / k);
}

/** Vertices of the surface of a cube of n cells a side, in the order of their indices, and the quads between them. */
function cube(n) {
  const index = new Map(), points = [], quads = [];
  const key = (p) => (p[0] * (n + 1) + p[1]) * (n + 1) + p[2];
  for (let i = 0; i <= n; i++) for (let j = 0; j <= n; j++) for (let k = 0; k <= n; k++) {
    if ([i, j, k].some((c) => c === 0 || c === n)) { index.set(key([i, j, k]), points.length); points.push([i, j, k]); }
  }
  for (let axis = 0; axis < 3; axis++) for (const level of [0, n]) {
    const around = level ? [[0, 0], [1, 0], [1, 1], [0, 1]] : [[0, 0], [0, 1], [1, 1], [1, 0]];
    for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) for (const [di, dj] of around) {
      const point = [0, 0, 0];
      point[axis] = level; point[(axis + 1) % 3] = i + di; point[(axis + 2) % 3] = j + dj;
      quads.push(index.get(key(point)));
    }
  }
  return { points, index, key, quads };
}

function directions(points, n) {
  return points.map((point) => {
    const t = point.map((c) => Math.tan(Math.PI / 4 * (2 * c / n - 1))), r = Math.hypot(...t);
    return t.map((c) => c / r);
  });
}

function ring(angle, exponent) {
  const c = Math.cos(angle), s = Math.sin(angle), r = norm(c, s, exponent);
  return [c / r, s / r];
}

/** Quads of rows by columns that close around, and along the rows too where `wrap` says so. */
function tube(rows, columns, wrap) {
  const quads = [], last = wrap ? rows : rows - 1;
  for (let r = 0; r < last; r++) for (let c = 0; c < columns; c++) {
    const next = (c + 1) % columns, up = (r + 1) % rows;
    quads.push(r * columns + c, r * columns + next, up * columns + next, up * columns + c);
  }
  return quads;
}

/** The terms of a kind's F at a scaled point, by the composition that the package's table of kinds gives. */
function terms(s, [x, y, z]) {
  const found = { x, y, z, one: 1 };
  const take = ([exponent, u, v]) => norm(found[u], found[v], s.exponents[exponent]);
  found.inner = take(s.kind.inner) - (s.hole ?? 0);
  found.outer = take(s.kind.outer);
  return found;
}

/** Grids over surfaces by their layout, in units of the semi-axes. */
const layouts = {
  sphere(s, n) {
    const grid = cube(n);
    const points = directions(grid.points, n).map((d) => { const t = terms(s, d), f = t[s.kind.over] / t[s.kind.under]; return d.map((c) => c / f); });
    return { points, quads: grid.quads, cube: grid };
  },
  torus(s, n) {
    const rows = 2 * Math.max(2, n), columns = 4 * n, points = [];
    for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
      const t = ring(2 * Math.PI * r / rows, s.exponents[0]), a = ring(2 * Math.PI * c / columns, s.exponents[1]);
      points.push([(s.hole + t[0]) * a[0], (s.hole + t[0]) * a[1], t[1]]);
    }
    return { points, quads: tube(rows, columns, true) };
  },
  tube(s, n) {
    const rows = 2 * n + 1, columns = 4 * n, cut = s.height / s.semi_axes[s.kind.cut_axis], points = [];
    for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
      const z = cut * (r / n - 1), a = ring(2 * Math.PI * c / columns, s.exponents[1]), f = terms(s, [...a, z]).outer;
      points.push([a[0] * f, a[1] * f, z]);
    }
    return { points, quads: tube(rows, columns, false) };
  },
  "two sheets"(s, n) {
    const grid = cube(n), all = directions(grid.points, n), cut = s.height / s.semi_axes[s.kind.cut_axis];
    const height = (y, z) => terms(s, [1, y, z]).outer, kept = new Map(), points = [], quads = [];
    all.forEach((d, v) => {
      if (d[0] < -1e-12) return;
      kept.set(v, points.length);
      const around = Math.hypot(d[1], d[2]), radius = Math.atan2(around, d[0]) / (Math.PI / 2);
      const y = d[1] / Math.max(around, TINY), z = d[2] / Math.max(around, TINY);
      let low = 0, high = 2 * cut;
      for (let step = 0; step < 60; step++) { const m = (low + high) / 2; if (height(y * m, z * m) < cut) low = m; else high = m; }
      points.push([height(y * radius * low, z * radius * low), y * radius * low, z * radius * low]);
    });
    const half = points.length;
    for (let q = 0; q < grid.quads.length; q += 4) {
      const corners = grid.quads.slice(q, q + 4).map((v) => kept.get(v));
      if (corners.every((v) => v !== undefined)) quads.push(...corners.slice().reverse(), ...corners.map((v) => v + half));
    }
    return { points: points.concat(points.map((p) => [-p[0], p[1], p[2]])), quads };
  },
};

/** A superquadric's grid in the world before deformation: { rest (3 N), quads (4 M), cube }. */
function restGrid(s, resolution) {
  const n = 2 * Math.max(1, Math.floor((resolution + 1) / 2));
  const layout = s.kind.layout, grid = layouts[layout](s, layout === "sphere" || layout === "two sheets" ? n : resolution);
  const rest = new Float64Array(3 * grid.points.length);
  grid.points.forEach((q, v) => {
    for (let c = 0; c < 3; c++) {
      let sum = s.translation[c];
      for (let a = 0; a < 3; a++) sum += s.rotation[c][a] * s.semi_axes[a] * q[a];
      rest[3 * v + c] = sum;
    }
  });
  return { rest, quads: Int32Array.from(grid.quads), cube: grid.cube, cells: n };
}

/** Bernstein polynomials of a degree at t, and their derivatives: factors of P18 and P19. */
function bernstein(t, degree) {
  let row = [1], below = [1];
  for (let d = 1; d <= degree; d++) {
    below = row;
    row = new Array(d + 1).fill(0);
    below.forEach((b, i) => { row[i] += (1 - t) * b; row[i + 1] += t * b; });
  }
  const derivative = row.map((_, i) => degree * ((below[i - 1] ?? 0) - (below[i] ?? 0)));
  return [row, derivative];
}

/** Everything about points that does not change when control points move: their Bernstein factors. */
function prepared(rest, box) {
  const count = rest.length / 3, sizes = box.shape, derivatives = [];
  const factors = sizes.map((size, axis) => {
    const edge = box.edges[axis], length = edge.reduce((s, e) => s + e * e, 0), table = new Float64Array(count * size);
    derivatives.push(new Float64Array(count * size));
    for (let v = 0; v < count; v++) {
      let t = 0;  // (P15, P16)
      for (let c = 0; c < 3; c++) t += (rest[3 * v + c] - box.origin[c]) * edge[c] / length;
      const [row, derivative] = bernstein(t, size - 1);
      table.set(row, v * size); derivatives[axis].set(derivative, v * size);
    }
    return table;
  });
  return { count, sizes, factors, derivatives };
}

/** Where displaced control points (3 K) carry prepared points (P19); with other factors along an axis, their derivative. */
function carried(points, control, [A, B, C] = points.factors) {
  const [l, m, n] = points.sizes, result = new Float64Array(3 * points.count);
  for (let v = 0; v < points.count; v++) {
    let x = 0, y = 0, z = 0, at = 0;
    for (let i = 0; i < l; i++) for (let j = 0; j < m; j++) {
      const ab = A[v * l + i] * B[v * m + j];
      for (let k = 0; k < n; k++, at += 3) {
        const w = ab * C[v * n + k];
        x += w * control[at]; y += w * control[at + 1]; z += w * control[at + 2];
      }
    }
    result[3 * v] = x; result[3 * v + 1] = y; result[3 * v + 2] = z;
  }
  return result;
}

/** det(d deformed / d point) at prepared points. */
function determinants(points, control, box) {
  const [A, B, C] = points.factors, [a, b, c] = points.derivatives;
  const along = [carried(points, control, [a, B, C]), carried(points, control, [A, b, C]), carried(points, control, [A, B, c])];
  const volume = Math.abs(triple(box.edges[0], box.edges[1], box.edges[2]));
  const sign = Math.sign(triple(box.edges[0], box.edges[1], box.edges[2]));
  return Float64Array.from({ length: points.count }, (_, v) => {
    const [s, t, u] = along.map((d) => d.subarray(3 * v, 3 * v + 3));
    return sign * triple(s, t, u) / volume;
  });
}

const triple = (a, b, c) => a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);

/** Triangles of quads, cut along the shorter diagonal. */
function triangles(quads, x) {
  const result = new Int32Array(quads.length / 4 * 6);
  const distance = (p, q) => {
    const u = x[3 * p] - x[3 * q], v = x[3 * p + 1] - x[3 * q + 1], w = x[3 * p + 2] - x[3 * q + 2];
    return Math.sqrt(u * u + v * v + w * w);
  };
  for (let q = 0, at = 0; q < quads.length; q += 4, at += 6) {
    const a = quads[q], b = quads[q + 1], c = quads[q + 2], d = quads[q + 3];
    const first = distance(a, c) <= distance(b, d) * (1 + 1e-9);
    result[at] = a; result[at + 1] = b; result[at + 2] = first ? c : d;
    result[at + 3] = first ? a : b; result[at + 4] = c; result[at + 5] = d;
  }
  return result;
}

/** The quads with a corner below a plane [point, direction]; all without one. */
function quadsBelow(quads, x, plane) {
  if (!plane) return quads;
  const [point, direction] = plane, kept = [];
  const below = (v) => direction.reduce((sum, n, k) => sum + n * (x[3 * v + k] - point[k]), 0) <= 0;
  for (let q = 0; q < quads.length; q += 4) { const corners = [...quads.slice(q, q + 4)]; if (corners.some(below)) kept.push(...corners); }
  return Int32Array.from(kept);
}

/** Fraction of a triangle's area below zero, by the heights of its corners. */
function fractionBelow(h0, h1, h2) {
  const count = (h0 <= 0) + (h1 <= 0) + (h2 <= 0);
  if (count === 0 || count === 3) return count / 3;
  const alone = count === 1;  // turn the corner that is alone on its side to the front
  if ((h1 <= 0) === alone) [h0, h1, h2] = [h1, h2, h0];
  else if ((h2 <= 0) === alone) [h0, h1, h2] = [h2, h0, h1];
  const tip = h0 * h0 / ((h0 - h1) * (h0 - h2));
  return alone ? tip : 1 - tip;
}

/** Volume by the divergence theorem, below a plane [point, direction] or of all of it. */
function meshVolume(x, quads, plane) {
  const faces = triangles(quads, x), origin = [0, 0, 0], [nx, ny, nz] = plane ? plane[1] : [0, 0, 0];
  if (plane) origin.splice(0, 3, ...plane[0]);
  else for (let v = 0; v < x.length; v++) origin[v % 3] += 3 * x[v] / x.length;
  const [ox, oy, oz] = origin;
  let sum = 0;
  for (let f = 0; f < faces.length; f += 3) {
    const a = 3 * faces[f], b = 3 * faces[f + 1], c = 3 * faces[f + 2];
    const ax = x[a] - ox, ay = x[a + 1] - oy, az = x[a + 2] - oz, bx = x[b] - ox, by = x[b + 1] - oy, bz = x[b + 2] - oz;
    const cx = x[c] - ox, cy = x[c + 1] - oy, cz = x[c + 2] - oz;
    const six = ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx);
    sum += plane ? six * fractionBelow(ax * nx + ay * ny + az * nz, bx * nx + by * ny + bz * nz, cx * nx + cy * ny + cz * nz) : six;
  }
  return sum / 6;
}

/** Values of all splines at a time. */
function splineWeights(time, t) {
  const { breaks, pieces, period } = time;
  const first = breaks[0], last = breaks[breaks.length - 1];
  if (period) t = first + ((t - first) % period + period) % period;
  t = Math.min(Math.max(t, first), last);
  let i = 0;
  while (i < breaks.length - 2 && t >= breaks[i + 1]) i++;
  const d = t - breaks[i];
  return pieces[i].map(([c3, c2, c1, c0]) => ((c3 * d + c2) * d + c1) * d + c0);
}
