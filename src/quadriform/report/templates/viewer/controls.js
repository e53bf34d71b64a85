// Mouse, fingers, keys and fields; the curve of the volume; and the word "ready".

const pointers = new Map();
let activePoint = null;

function listen() {
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId); pointers.set(e.pointerId, [e.clientX, e.clientY]);
    activePoint = $("show-box").checked ? nearestControlPoint(e) : null;
  });
  canvas.addEventListener("pointermove", dragged);
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => { pointers.delete(e.pointerId); activePoint = null; });
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); camera.zoom(Math.exp(e.deltaY / 600)); moving(); }, { passive: false });
  canvas.addEventListener("webglcontextlost", (e) => { e.preventDefault(); withoutWebgl(); });
  canvas.addEventListener("keydown", key);
}

function dragged(e) {
  const before = pointers.get(e.pointerId);
  if (!before) return;
  const dx = e.clientX - before[0], dy = e.clientY - before[1], unit = 2 * camera.reach / canvas.clientHeight;
  if (pointers.size === 2) {
    const other = [...pointers].find(([id]) => id !== e.pointerId)[1], distance = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    camera.zoom(distance(before) / Math.max(distance([e.clientX, e.clientY]), 1));
  } else if (activePoint !== null) {
    const by = [0, 1, 2].map((c) => unit * (dx * camera.rotation[0][c] - dy * camera.rotation[1][c])), [, m, n] = data.box.shape;
    moveControlPoint(Math.floor(activePoint / (m * n)), Math.floor(activePoint / n) % m, activePoint % n, by);
  } else if (e.shiftKey) {
    camera.centre = camera.centre.map((c, k) => c - unit * (dx * camera.rotation[0][k] - dy * camera.rotation[1][k]));
  } else camera.rotate(-dx / 150, -dy / 150);
  pointers.set(e.pointerId, [e.clientX, e.clientY]);
  moving();
}

function nearestControlPoint(e) {
  const control = controlAt(state.time), area = canvas.getBoundingClientRect(), scale = area.height / 2 / camera.reach;
  let best = null, least = 14;
  for (let v = 0; v < size; v += 3) {
    const [x, y] = camera.seen(control, v), away = Math.hypot(area.width / 2 + scale * x - (e.clientX - area.left), area.height / 2 - scale * y - (e.clientY - area.top));
    if (away < least) { least = away; best = v / 3; }
  }
  return best;
}

function key(e) {
  const step = 0.12, acts = {
    ArrowLeft: () => camera.rotate(step, 0), ArrowRight: () => camera.rotate(-step, 0), ArrowUp: () => camera.rotate(0, step),
    ArrowDown: () => camera.rotate(0, -step), "+": () => camera.zoom(0.9), "=": () => camera.zoom(0.9), "-": () => camera.zoom(1 / 0.9), 0: () => camera.reset(),
  };
  if (e.key === " " && data.time) { e.preventDefault(); play(); return; }
  if (!acts[e.key]) return;
  e.preventDefault(); acts[e.key](); moving();
}

// --- time ------------------------------------------------------------------------------------------------------------

let playing = 0;
const last = data.time ? frames[0] + (data.time.period ?? frames[frames.length - 1] - frames[0]) : 0;
const tick = (last - frames[0]) / (8 * Math.max(frames.length, 1));

function play() {
  if (playing) { cancelAnimationFrame(playing); playing = 0; } else playing = requestAnimationFrame(step);
  $("play").textContent = playing ? "pause" : "play"; $("play").setAttribute("aria-pressed", String(Boolean(playing)));
}

function step() {
  setTime(state.time + tick > last + 1e-9 * tick ? frames[0] : state.time + tick);
  if (playing) playing = requestAnimationFrame(step);
}

let volumes = [];
function curve() {
  const cavity = closed.find((s) => s.name === data.cavity);
  if (!data.time || !cavity) return;
  volumes = frames.map((t) => volumeOf(cavity, t));
  const low = Math.min(...volumes), high = Math.max(...volumes);
  state.ejection = 100 * (1 - volumes[volumes.indexOf(low)] / high);
  const ends = data.time.period ? [[last, volumes[0]]] : [];
  $("line").setAttribute("points", [...volumes.map((v, i) => [frames[i], v]), ...ends].map(([t, v]) => curvePoint(t, v)).join(" "));
  $("highest").textContent = `${digits(high)} ${data.volume_unit}`; $("lowest").textContent = digits(low);
  marker();
}

function curvePoint(t, v) {
  const low = Math.min(...volumes), high = Math.max(...volumes);
  return `${3 + 94 * (t - frames[0]) / (last - frames[0] || 1)},${90 - 80 * (v - low) / (high - low || 1)}`;
}

function marker() {
  if (!volumes.length) return;
  const at = curvePoint(state.time, volumeOf(closed.find((s) => s.name === data.cavity), state.time));
  $("now").setAttribute("d", `M${at}h0`);
}

// --- fields ----------------------------------------------------------------------------------------------------------

for (const s of data.surfaces) for (const id of [`show-${s.name}`, `alpha-${s.name}`]) $(id).addEventListener("input", draw);
for (const id of ["show-points", "show-box", "show-arrows", "resolution"]) $(id).addEventListener("input", draw);
$("colour").addEventListener("input", () => { state.colour = $("colour").value; draw(); });
$("reset").addEventListener("click", () => { camera.reset(); draw(); });
$("time").addEventListener("input", () => setTime(Number($("time").value)));
$("play").addEventListener("click", play);
$("volume-curve").addEventListener("click", (e) => {
  const area = e.currentTarget.getBoundingClientRect(), x = (e.clientX - area.left) * 100 / area.width;
  setTime(Math.min(Math.max(frames[0] + (x - 3) / 94 * (last - frames[0]), frames[0]), last));
});
$("move").addEventListener("submit", (e) => {
  e.preventDefault();
  const [i, j, k, ...by] = ["i", "j", "k", "dx", "dy", "dz"].map((id) => Number($(`move-${id}`).value));
  moveControlPoint(i, j, k, by);
});
$("undo").addEventListener("click", () => { edits.fill(0); state.picked = null; hidden("undo", true); curve(); numbers(); draw(); });
window.addEventListener("resize", draw);

choosePainter();
listen();
hidden("in-time", !data.time);
if (data.time) Object.assign($("time"), { min: frames[0], max: last, step: tick, value: frames[0] });
draw();
curve();
numbers();
const named = (name) => data.surfaces.find((s) => s.name === name);
window.quadriform = {
  renderer, camera, draw, setTime, moveControlPoint,
  displace: (by) => { edits.set(by); moving(); edited(); },
  volume: (name, t = state.time) => volumeOf(named(name), t),
  vertices: (name, cells, t = state.time) => [...carried(gridOf(named(name), cells).prepared, controlAt(t))],
};
document.title = `ready: ${document.title}`;
