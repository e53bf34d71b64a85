// The scene by WebGL 2: surfaces with light from the eye, points, lines.

const VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in vec4 colour;
uniform mat3 rotation; uniform vec3 centre; uniform vec2 scale; uniform float depth, size;
out vec4 tone; out vec3 facing;
void main() {
  vec3 p = rotation * (position - centre);
  gl_Position = vec4(p.xy * scale, -p.z * depth, 1.0);
  gl_PointSize = size; tone = colour; facing = rotation * normal;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec4 tone; in vec3 facing; uniform float alpha, lit; out vec4 result;
void main() {
  float light = mix(1.0, 0.35 + 0.65 * abs(normalize(facing + vec3(0, 0, 1e-6)).z), lit);
  result = vec4(tone.rgb * light, alpha);
}`;

class WebglPainter {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("no WebGL 2");
    this.gl = gl;
    this.program = this.linked();
    gl.useProgram(this.program);
    this.at = (name) => gl.getUniformLocation(this.program, name);
    this.buffers = new Map();
  }
  linked() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(program, shader);
    }
    ["position", "normal", "colour"].forEach((name, i) => gl.bindAttribLocation(program, i, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }
  paint(shapes, camera) {
    const gl = this.gl, { width, height } = gl.canvas, rotation = camera.rotation;
    gl.viewport(0, 0, width, height);
    gl.clearColor(1, 1, 1, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniformMatrix3fv(this.at("rotation"), false, [0, 1, 2].flatMap((c) => rotation.map((row) => row[c])));
    gl.uniform3fv(this.at("centre"), camera.centre);
    gl.uniform2f(this.at("scale"), height / width / camera.reach, 1 / camera.reach);
    gl.uniform1f(this.at("depth"), 1 / (20 * camera.home.reach));
    shapes.filter((s) => s.alpha === 1).forEach((s) => this.draw(s));
    gl.depthMask(false); gl.enable(gl.BLEND); gl.enable(gl.CULL_FACE);
    for (const side of [gl.FRONT, gl.BACK]) {  // far sides first
      gl.cullFace(side);
      shapes.filter((s) => s.alpha < 1).forEach((s) => this.draw(s));
    }
    gl.disable(gl.CULL_FACE); gl.disable(gl.BLEND); gl.depthMask(true);
  }
  draw(shape) {
    const gl = this.gl, fill = (slot, data, size, type) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer(slot)); gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(slot); gl.vertexAttribPointer(slot, size, type, type === gl.UNSIGNED_BYTE, 0, 0);
    };
    fill(0, Float32Array.from(shape.x), 3, gl.FLOAT);
    if (shape.normals) fill(1, Float32Array.from(shape.normals), 3, gl.FLOAT); else { gl.disableVertexAttribArray(1); gl.vertexAttrib3f(1, 0, 0, 1); }
    fill(2, shape.colours, 4, gl.UNSIGNED_BYTE);
    gl.uniform1f(this.at("alpha"), shape.alpha); gl.uniform1f(this.at("lit"), shape.quads ? 1 : 0);
    gl.uniform1f(this.at("size"), (shape.size ?? 1) * (window.devicePixelRatio || 1));
    if (!shape.quads) { gl.drawArrays(shape.lines ? gl.LINES : gl.POINTS, 0, shape.x.length / 3); return; }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffer("faces"));
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, Uint32Array.from(triangles(shape.quads, shape.x)), gl.DYNAMIC_DRAW);
    gl.drawElements(gl.TRIANGLES, shape.quads.length / 4 * 6, gl.UNSIGNED_INT, 0);
  }
  buffer(slot) {
    if (!this.buffers.has(slot)) this.buffers.set(slot, this.gl.createBuffer());
    return this.buffers.get(slot);
  }
}
