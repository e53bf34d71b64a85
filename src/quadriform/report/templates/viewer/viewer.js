// The viewer: what is shown, what is asked for, and the numbers beside it.

const data = JSON.parse(document.getElementById("model").textContent);
const $ = (id) => document.getElementById(id);
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const hidden = (id, hide) => { $(id).hidden = hide; };
const FINE = 32, DRAGGED = 12;

const knots = new Float32Array(bytes(data.control));
const size = 3 * data.box.shape.reduce((a, b) => a * b, 1);
const edits = new Float64Array(size);
const frames = data.time ? data.time.frames : [0];
const state = { time: frames[0], colour: "plain", busy: false };

/** Control points (3 K) at a time, moved by hand where they were. */
function controlAt(t) {
  const weights = data.time ? splineWeights(data.time, t) : [1], result = Float64Array.from(edits);
  for (let i = 0; i < size; i++) {
    result[i] += data.centre[i % 3];
    for (let k = 0; k < weights.length; k++) result[i] += weights[k] * knots[k * size + i];
  }
  return result;
}

const frameAt = (t) => frames.reduce((best, at, i) => (Math.abs(at - t) < Math.abs(frames[best] - t) ? i : best), 0);

// --- parameters -------------------------------------------------------------------------------------------------------

const grids = new Map();
function gridOf(surface, n) {
  const key = `${surface.name} ${n}`;
  if (!grids.has(key)) { const g = restGrid(surface, n); grids.set(key, { ...g, prepared: prepared(g.rest, data.box) }); }
  return grids.get(key);
}

/** Volume in the report's unit, by Richardson's extrapolation from two grids, below the base where there is one. */
function volumeOf(surface, t) {
  const plane = data.planes && surface.name === data.cavity ? data.planes[frameAt(t)] : null, control = controlAt(t);
  const [coarse, fine] = [FINE, 2 * FINE].map((n) => { const g = gridOf(surface, n); return meshVolume(carried(g.prepared, control), g.quads, plane); });
  return (fine + (fine - coarse) / 3) * data.volume_scale;
}

const digits = (value) => String(Number(value.toPrecision(4)));
const closed = data.surfaces.filter((s) => s.kind.cut_axis === null);

function numbers() {
  const rows = closed.map((s) => [`volume, ${s.name}`, `${digits(volumeOf(s, state.time))} ${data.volume_unit}`, `volume-${s.name}`]);
  if (state.ejection !== undefined) rows.push(["ejection fraction", `${digits(state.ejection)} %`, "ejection"]);
  const error = data.errors[frameAt(state.time)];
  if (error != null) rows.push(["error RMS of the fit", `${digits(error)} ${data.unit}`, "error"]);
  if (data.time) rows.unshift(["time", digits(state.time), "time-now"]);
  $("numbers").replaceChildren(...rows.map(([name, value, id]) => {
    const row = document.createElement("tr"), head = document.createElement("th"), cell = document.createElement("td");
    head.scope = "row"; head.textContent = name; cell.textContent = value; cell.id = id; row.append(head, cell);
    return row;
  }));
}

// --- what is drawn ---------------------------------------------------------------------------------------------------

const points = new Map(Object.entries(data.points).map(([name, list]) => [name, list.map(unpacked)]));
function unpacked(frame) {
  const xyz = new Int16Array(bytes(frame.xyz)), residual = new Int16Array(bytes(frame.residuals));
  return {
    x: Float64Array.from(xyz, (v, i) => v * data.quantum + data.centre[i % 3]),
    residual: Float64Array.from(residual, (v) => v * data.residual_quantum),
  };
}

/** Values of a field at the vertices of a grid, between those of the coarser or finer one that the page holds. */
function fieldValues(field, surface, grid) {
  const list = field.values[surface.name];
  if (!list || !grid.cube) return null;
  const coded = new Uint8Array(bytes(list[Math.min(frameAt(state.time), list.length - 1)])), coarse = cube(field.cells);
  return grid.cube.points.map((point) => {
    const at = point.map((c) => c * field.cells / grid.cells), found = [];
    for (const round of [Math.floor, Math.ceil]) { const v = coarse.index.get(coarse.key(at.map(round))); if (v !== undefined) found.push(coded[v]); }
    const good = found.filter((c) => c !== 255);
    return good.length ? field.low + (field.high - field.low) * good.reduce((a, b) => a + b, 0) / good.length / 254 : NaN;
  });
}

function surfaceValues(surface, grid, x, control) {
  if (state.colour === "displacement") {
    return Float64Array.from({ length: x.length / 3 }, (_, v) => Math.hypot(...[0, 1, 2].map((k) => x[3 * v + k] - grid.rest[3 * v + k])));
  }
  if (state.colour === "jacobian") return determinants(grid.prepared, control, data.box);
  const field = data.fields.find((f) => f.name === state.colour);
  return field ? fieldValues(field, surface, grid) : null;
}

function legendOf(values) {
  const field = data.fields.find((f) => f.name === state.colour);
  if (field) return field.low < 0 ? [field.low, field.high, "diverging"] : [field.low, field.high, "sequential"];
  return limits(values.flatMap((v) => (v ? [...v] : [])));
}

function shapes(resolution) {
  const control = controlAt(state.time), shown = data.surfaces.filter((s) => $(`show-${s.name}`).checked);
  const base = data.planes ? data.planes[frameAt(state.time)] : null;  // what lies beyond is neither measured nor counted
  const parts = shown.map((surface) => {
    const grid = gridOf(surface, resolution), x = carried(grid.prepared, control);
    return { surface, grid, x, values: surfaceValues(surface, grid, x, control) };
  });
  state.legend = state.colour === "plain" ? null : legendOf(parts.map((p) => p.values));
  const result = parts.map(({ surface, grid, x, values }) => ({
    x, quads: quadsBelow(grid.quads, x, base), normals: normals(x, grid.quads), alpha: Number($(`alpha-${surface.name}`).value),
    colours: values ? colours(Array.from(values), state.legend) : plainColours(x.length / 3, state.legend ? NO_DATA : rgb(surface.colour)),
  }));
  if ($("show-points").checked) for (const s of shown) result.push(...pointShape(s));
  if ($("show-box").checked) result.push(...boxShapes(control));
  if ($("show-arrows").checked) result.push(...shown.map((s) => arrows(s, control)));
  return result;
}

function pointShape(surface) {
  const frame = points.get(surface.name)?.[frameAt(state.time)];
  if (!frame || !frame.x.length) return [];
  const residual = data.fields.find((f) => f.name === "residual");
  const toned = state.colour === "residual" && residual;
  const tones = toned ? colours(Array.from(frame.residual), [residual.low, residual.high, "diverging"]) : plainColours(frame.residual.length, [40, 40, 40]);
  return [{ x: frame.x, colours: tones, alpha: 1, size: frame.residual.length > 4000 ? 1.5 : 3 }];
}

function boxShapes(control) {
  const [l, m, n] = data.box.shape, at = (i, j, k) => 3 * ((i * m + j) * n + k), ends = [];
  for (let i = 0; i < l; i++) for (let j = 0; j < m; j++) for (let k = 0; k < n; k++) {
    if (i + 1 < l) ends.push(at(i, j, k), at(i + 1, j, k));
    if (j + 1 < m) ends.push(at(i, j, k), at(i, j + 1, k));
    if (k + 1 < n) ends.push(at(i, j, k), at(i, j, k + 1));
  }
  const x = Float64Array.from(ends.flatMap((v) => [control[v], control[v + 1], control[v + 2]]));
  const knobs = plainColours(size / 3, [90, 60, 160]);
  if (state.picked != null) knobs.set([220, 40, 40], 4 * state.picked);
  return [{ x, lines: true, colours: plainColours(x.length / 3, [150, 140, 180]), alpha: 1 }, { x: control, colours: knobs, alpha: 1, size: 6 }];
}

function arrows(surface, control) {
  const grid = gridOf(surface, 8), x = carried(grid.prepared, control), ends = [];
  for (let v = 0; v < x.length; v += 3) ends.push(...grid.rest.subarray(v, v + 3), ...x.subarray(v, v + 3));
  const tones = plainColours(ends.length / 3, [200, 90, 20]);
  for (let v = 0; v < ends.length / 3; v += 2) tones.set([120, 120, 120], 4 * v);
  return { x: Float64Array.from(ends), lines: true, colours: tones, alpha: 1 };
}

function legend() {
  hidden("legend", !state.legend);
  if (!state.legend) return;
  const [low, high, ramp] = state.legend, unit = { displacement: data.unit, jacobian: "det J" }[state.colour] ?? data.fields.find((f) => f.name === state.colour).unit;
  $("ramp").style.background = `linear-gradient(to right, ${RAMPS[ramp].join(", ")})`;
  $("low").textContent = digits(low); $("high").textContent = `${digits(high)} ${unit}`; $("legend-name").textContent = state.colour;
}

// --- looking ---------------------------------------------------------------------------------------------------------

let canvas = $("scene"), painter, renderer, coarse = false, later = 0;
const camera = new Camera(data.centre, data.reach);

function choosePainter() {
  for (const [Kind, name] of [[WebglPainter, "webgl"], [CanvasPainter, "canvas"]]) {
    try { painter = new Kind(canvas); renderer = name; break; } catch { /* the next one needs less */ }
  }
}

/** A new canvas in place of one whose WebGL is gone. */
function withoutWebgl() {
  const fresh = canvas.cloneNode(); canvas.replaceWith(fresh); canvas = fresh;
  painter = new CanvasPainter(canvas); renderer = "canvas"; listen(); draw();
}

function fit() {
  const ratio = window.devicePixelRatio || 1, width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
}

function draw() {
  fit();
  const asked = Number($("resolution").value);
  painter.paint(shapes(coarse && renderer === "canvas" ? Math.min(asked, DRAGGED) : asked), camera);
  legend(); triad();
  canvas.setAttribute("aria-label", `${data.title}: ${data.surfaces.filter((s) => $(`show-${s.name}`).checked).map((s) => s.name).join(", ") || "nothing"} shown${data.time ? ` at time ${digits(state.time)}` : ""}`);
}

/** Coarsely while something moves, finely when it rests. */
function moving() {
  coarse = true; draw(); clearTimeout(later);
  later = setTimeout(() => { coarse = false; draw(); }, 150);
}

function triad() {
  $("triad").replaceChildren(...data.axes.flatMap((letter, a) => {
    const [x, y] = camera.rotation.map((row) => row[a]), make = (tag, set) => {
      const e = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const [k, v] of Object.entries(set)) e.setAttribute(k, v);
      return e;
    };
    const text = make("text", { x: 40 + 32 * x, y: 44 - 32 * y, "text-anchor": "middle" });
    text.textContent = letter;
    return [make("line", { x1: 40, y1: 40, x2: 40 + 24 * x, y2: 40 - 24 * y }), text];
  }));
}

function setTime(t) {
  state.time = t; $("time").value = t; moving(); numbers(); marker();
}

function moveControlPoint(i, j, k, by) {
  const [, m, n] = data.box.shape, at = 3 * ((i * m + j) * n + k);
  by.forEach((d, c) => { edits[at + c] += d; });
  state.picked = at / 3; moving(); edited();
}

let pending = 0;
function edited() {  // the numbers of the whole cycle take a while: when the hand rests
  clearTimeout(pending);
  pending = setTimeout(() => { curve(); numbers(); }, 200);
  hidden("undo", false);
}
