// What is to be drawn: shapes with positions, normals and colours, in the world; and how it is looked at.

const RAMPS = {
  sequential: ["#17274f", "#22557f", "#2f8590", "#6db286", "#c3d36f", "#fdeb6e"],
  diverging: ["#1f4e9c", "#7fa6d6", "#f3f3f0", "#e3a07c", "#a8321f"],
};
const NO_DATA = [150, 150, 150];
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

function ramped(fraction, ramp) {
  if (!(fraction === fraction)) return NO_DATA;
  const stops = RAMPS[ramp], at = Math.min(Math.max(fraction, 0), 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2);
  const [a, b] = [rgb(stops[i]), rgb(stops[i + 1])];
  return a.map((c, k) => c + (at - i) * (b[k] - c));
}

/** Limits of a legend: around zero for values of both signs, else from the least to the largest. */
function limits(values) {
  let low = Infinity, high = -Infinity;
  for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  if (!(low <= high)) return [0, 1, "sequential"];
  if (low < 0 && high > 0) { const most = Math.max(-low, high); return [-most, most, "diverging"]; }
  return [low, high > low ? high : low + 1, "sequential"];
}

function colours(values, [low, high, ramp]) {
  const result = new Uint8Array(4 * values.length);
  values.forEach((v, i) => { result.set(ramped((v - low) / (high - low), ramp), 4 * i); result[4 * i + 3] = 255; });
  return result;
}

function plainColours(count, colour) {
  const result = new Uint8Array(4 * count);
  for (let i = 0; i < count; i++) { result.set(colour, 4 * i); result[4 * i + 3] = 255; }
  return result;
}

/** Unit normals at vertices: the sum of those of the quads around. */
function normals(x, quads) {
  const result = new Float64Array(x.length);
  for (let q = 0; q < quads.length; q += 4) {
    const [a, b, c, d] = [quads[q], quads[q + 1], quads[q + 2], quads[q + 3]].map((v) => 3 * v);
    const ux = x[c] - x[a], uy = x[c + 1] - x[a + 1], uz = x[c + 2] - x[a + 2];
    const vx = x[d] - x[b], vy = x[d + 1] - x[b + 1], vz = x[d + 2] - x[b + 2];
    const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const v of [a, b, c, d]) for (let k = 0; k < 3; k++) result[v + k] += n[k];
  }
  for (let v = 0; v < x.length; v += 3) {
    const r = Math.hypot(result[v], result[v + 1], result[v + 2]) || 1;
    for (let k = 0; k < 3; k++) result[v + k] /= r;
  }
  return result;
}

/** How the scene is looked at: a rotation of the world, a centre, and how many units fit into half the height. */
class Camera {
  constructor(centre, reach) { this.home = { centre, reach }; this.reset(); }
  reset() {
    this.rotation = [[1, 0, 0], [0, 0, 1], [0, -1, 0]];  // x to the right, z upwards, from the side of -y
    this.centre = this.home.centre.slice(); this.reach = this.home.reach;
    this.rotate(0.5, -0.35);
  }
  rotate(right, down) {
    const [c, s, C, S] = [Math.cos(right), Math.sin(right), Math.cos(down), Math.sin(down)];
    const [x, y, z] = this.rotation;
    const a = x.map((_, k) => c * x[k] + s * z[k]), d = x.map((_, k) => -s * x[k] + c * z[k]);
    this.rotation = [a, y.map((_, k) => C * y[k] - S * d[k]), y.map((_, k) => S * y[k] + C * d[k])];
  }
  zoom(factor) { this.reach = Math.min(Math.max(this.reach * factor, this.home.reach / 50), this.home.reach * 20); }
  seen(x, v) {
    const p = [x[v] - this.centre[0], x[v + 1] - this.centre[1], x[v + 2] - this.centre[2]];
    return this.rotation.map((row) => row[0] * p[0] + row[1] * p[1] + row[2] * p[2]);
  }
}
