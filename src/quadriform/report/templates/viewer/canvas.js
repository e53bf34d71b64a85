// The same scene on a plain canvas, for machines without WebGL: far things first, nearer ones over them.

class CanvasPainter {
  constructor(canvas) {
    this.context = canvas.getContext("2d", { alpha: false });
    if (!this.context) throw new Error("no canvas");
  }
  paint(shapes, camera) {
    const c = this.context, { width, height } = c.canvas, scale = height / 2 / camera.reach;
    c.fillStyle = "#fff"; c.globalAlpha = 1; c.fillRect(0, 0, width, height);
    const pieces = shapes.flatMap((shape) => this.pieces(shape, camera));
    pieces.sort((a, b) => a.depth - b.depth);
    const to = (p) => [width / 2 + scale * p[0], height / 2 - scale * p[1]];
    for (const piece of pieces) {
      c.globalAlpha = piece.alpha;
      c.fillStyle = c.strokeStyle = piece.colour;
      const corners = piece.corners.map(to);
      if (corners.length === 1) { c.fillRect(corners[0][0] - piece.size / 2, corners[0][1] - piece.size / 2, piece.size, piece.size); continue; }
      c.beginPath();
      corners.forEach(([x, y], i) => (i ? c.lineTo(x, y) : c.moveTo(x, y)));
      if (corners.length === 2) { c.lineWidth = 1; c.stroke(); continue; }
      c.closePath(); c.fill();
      if (piece.alpha === 1) { c.lineWidth = 0.7; c.stroke(); }  // or the seams between quads show
    }
    c.globalAlpha = 1;
  }
  pieces(shape, camera) {
    const count = shape.x.length / 3, seen = [], result = [];
    for (let v = 0; v < count; v++) seen.push(camera.seen(shape.x, 3 * v));
    const each = shape.quads ? 4 : shape.lines ? 2 : 1, total = shape.quads ? shape.quads.length : count;
    const size = (shape.size ?? 1) * (window.devicePixelRatio || 1);
    for (let i = 0; i < total; i += each) {
      const index = [...Array(each).keys()].map((k) => (shape.quads ? shape.quads[i + k] : i + k)), corners = index.map((v) => seen[v]);
      const light = each === 4 ? 0.35 + 0.65 * this.facing(corners) : 1;
      const tone = [0, 1, 2].map((k) => Math.round(light * index.reduce((s, v) => s + shape.colours[4 * v + k], 0) / each));
      const depth = corners.reduce((s, p) => s + p[2], 0) / each;
      result.push({ corners, depth, size, alpha: shape.alpha, colour: `rgb(${tone})` });
    }
    return result;
  }
  facing([a, b, c, d]) {
    const u = [0, 1, 2].map((k) => c[k] - a[k]), v = [0, 1, 2].map((k) => d[k] - b[k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    return Math.abs(n[2]) / (Math.hypot(...n) || 1);
  }
}
