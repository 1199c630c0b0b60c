// The 3-D view of a report: WebGL 2 without libraries. Everything it shows comes from #payload.
// viewer_page.js follows in the same script element, then the scripts of one page, which set poses,
// and call startViewer.
"use strict";

const data = JSON.parse(document.getElementById("payload").textContent);
const byId = (id) => document.getElementById(id);
const state = {
  chosen: 0, mapped: false, moved: false,
  shown: { hand: true, object: true, map: true, points: true, grid: true, region: true, palm: true, root: true },
};
const camera = { azimuth: 0.6, elevation: 0.4, distance: 0.6, target: [0, 0, 0] };

// -- payload ------------------------------------------------------------------------------------

const ARRAYS = { f32: Float32Array, i16: Int16Array, i8: Int8Array, u8: Uint8Array, u16: Uint16Array, u32: Uint32Array };

function array(packed) {
  const text = atob(packed.data);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new ARRAYS[packed.type](bytes.buffer);
}

// -- small matrices, column-major ---------------------------------------------------------------

function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++)
      for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

function eyeDirection() {
  const flat = Math.cos(camera.elevation);
  return [flat * Math.cos(camera.azimuth), flat * Math.sin(camera.azimuth), Math.sin(camera.elevation)];
}

function axes() {
  const z = eyeDirection();
  const x = [-Math.sin(camera.azimuth), Math.cos(camera.azimuth), 0];
  const y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
  return [x, y, z];
}

function viewMatrix() {
  const [x, y, z] = axes();
  const t = camera.target, dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  return new Float32Array([
    x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
    -dot(x, t), -dot(y, t), -dot(z, t) - camera.distance, 1,
  ]);
}

const FIELD_OF_VIEW = 0.42;

function projection(aspect) {
  const f = 1 / Math.tan(FIELD_OF_VIEW / 2), near = 0.02, far = camera.distance + 3;
  const out = new Float32Array(16);
  out[0] = f / aspect; out[5] = f; out[10] = (near + far) / (near - far);
  out[11] = -1; out[14] = (2 * near * far) / (near - far);
  return out;
}

// -- drawing ------------------------------------------------------------------------------------

const MESH_VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in float value;
uniform mat4 view, project, model; uniform vec3 origin; uniform float spread;
out vec3 n; out vec3 p; out float v;
void main() {
  vec4 eye = view * (model * vec4(origin + spread * position, 1.0));
  n = mat3(view) * (mat3(model) * normal); p = eye.xyz; v = value;
  gl_Position = project * eye;
}`;
const MESH_FRAGMENT = `#version 300 es
precision highp float;
in vec3 n; in vec3 p; in float v;
uniform vec3 color; uniform vec3 scale[SCALE_STEPS]; uniform bool mapped; uniform float shine;
out vec4 result;
float light(vec3 normal, vec3 toward, float strength) { return strength * max(dot(normal, normalize(toward)), 0.0); }
void main() {
  vec3 toEye = normalize(-p), normal = normalize(n);
  if (dot(normal, toEye) < 0.0) normal = -normal;
  vec3 base = color;
  if (mapped) {
    float s = clamp(v, 0.0, 1.0) * float(SCALE_STEPS - 1); int i = min(int(s), SCALE_STEPS - 2);
    base = mix(scale[i], scale[i + 1], s - float(i));
  }
  float sky = mix(0.40, 0.60, 0.5 + 0.5 * normal.y);
  float lit = sky + light(normal, vec3(-0.5, 0.8, 1.0), 0.36) + light(normal, vec3(0.9, 0.15, 0.7), 0.26);
  vec3 halfway = normalize(normalize(vec3(-0.5, 0.8, 1.0)) + toEye);
  float gloss = shine * pow(max(dot(normal, halfway), 0.0), 40.0);
  float edge = pow(1.0 - max(dot(normal, toEye), 0.0), 3.0);
  result = vec4(base * lit * (1.0 - 0.38 * edge) + gloss, 1.0);
}`;
const DOT_VERTEX = `#version 300 es
in vec3 position; uniform mat4 view, project; uniform float size;
void main() {
  vec4 eye = view * vec4(position, 1.0);
  eye.xyz *= 0.985; // in front of the surface that it lies on
  gl_Position = project * eye; gl_PointSize = size;
}`;
const DOT_FRAGMENT = `#version 300 es
precision highp float; uniform vec3 color; out vec4 result;
void main() {
  float r = 2.0 * length(gl_PointCoord - 0.5);
  if (r > 1.0) discard;
  result = vec4(r > 0.68 ? vec3(1.0) : color, 1.0);
}`;
const GRID_VERTEX = `#version 300 es
in vec3 position; uniform mat4 view, project; uniform vec3 origin; uniform float spread; out vec2 at;
void main() { at = position.xy * spread; gl_Position = project * view * vec4(origin + spread * position, 1.0); }`;
const GRID_FRAGMENT = `#version 300 es
precision highp float; in vec2 at; uniform vec3 color; uniform float spread, table; out vec4 result;
float lines(float step) {
  vec2 g = at / step, w = fwidth(g), d = abs(fract(g - 0.5) - 0.5);
  vec2 l = (1.0 - smoothstep(w * 0.4, w * 1.4, d)) * clamp(0.5 / w - 1.0, 0.0, 1.0);
  return max(l.x, l.y);
}
void main() {
  float fade = 1.0 - smoothstep(0.35, 1.0, length(at) / spread);
  result = vec4(color, fade * max(table, max(0.16 * lines(0.01), 0.32 * lines(0.05))));
}`;

let gl = null, programs = null, scene = null;

function program(vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text.replaceAll("SCALE_STEPS", String(data.contact_scale.length)));
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  // the same slots everywhere, so that vertex arrays fit any program
  ["position", "normal", "value"].forEach((name, slot) => gl.bindAttribLocation(made, slot, name));
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const slots = {};
  return { use: () => gl.useProgram(made), slot: (name) => (slots[name] ??= gl.getUniformLocation(made, name)) };
}

function buffer(target, values, usage = gl.STATIC_DRAW) {
  const made = gl.createBuffer();
  gl.bindBuffer(target, made);
  gl.bufferData(target, values, usage);
  return made;
}

function attribute(slot, size, type, normalized) {
  gl.enableVertexAttribArray(slot);
  gl.vertexAttribPointer(slot, size, type, normalized, 0, 0);
}

function upload(mesh) {
  const layout = gl.createVertexArray();
  gl.bindVertexArray(layout);
  buffer(gl.ARRAY_BUFFER, array(mesh.positions));
  attribute(0, 3, gl.SHORT, true);
  buffer(gl.ARRAY_BUFFER, array(mesh.normals));
  attribute(1, 3, gl.BYTE, true);
  const values = buffer(gl.ARRAY_BUFFER, new Uint8Array(mesh.vertex_count), gl.DYNAMIC_DRAW);
  attribute(2, 1, gl.UNSIGNED_BYTE, true);
  const faces = array(mesh.faces);
  buffer(gl.ELEMENT_ARRAY_BUFFER, faces);
  gl.bindVertexArray(null);
  const kind = faces instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT;
  return { layout, values, count: faces.length, kind, origin: mesh.origin, spread: mesh.spread };
}

function pointLayout(values) {
  const layout = gl.createVertexArray();
  gl.bindVertexArray(layout);
  const points = buffer(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  attribute(0, 3, gl.FLOAT, false);
  gl.bindVertexArray(null);
  return { layout, points, count: values.length / 3 };
}

function setUp() {
  gl = byId("canvas").getContext("webgl2", { antialias: true });
  if (!gl) return say("this browser offers no WebGL 2, so there is no 3-D view");
  programs = {
    mesh: program(MESH_VERTEX, MESH_FRAGMENT), dot: program(DOT_VERTEX, DOT_FRAGMENT),
    grid: program(GRID_VERTEX, GRID_FRAGMENT),
  };
  scene = {
    object: data.object_mesh && upload(data.object_mesh),
    links: data.link_meshes.map((mesh) => ({ ...upload(mesh), color: mesh.color ?? data.colors.hand, role: mesh.role ?? "hand" })),
    dots: pointLayout(new Float32Array(0)),
    grid: pointLayout(new Float32Array([-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0])),
  };
  gl.enable(gl.DEPTH_TEST);
}

const IDENTITY = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
// one matrix per entry of data.link_meshes, or null: no hand
let poses = null;

function showDots(values) {
  gl.bindBuffer(gl.ARRAY_BUFFER, scene.dots.points);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  scene.dots.count = values.length / 3;
}

function drawMesh(mesh, model, color, shine, mapped) {
  const p = programs.mesh;
  gl.uniformMatrix4fv(p.slot("model"), false, model);
  gl.uniform3fv(p.slot("origin"), mesh.origin);
  gl.uniform1f(p.slot("spread"), mesh.spread);
  gl.uniform3fv(p.slot("color"), color);
  gl.uniform1f(p.slot("shine"), shine);
  gl.uniform1i(p.slot("mapped"), mapped);
  gl.bindVertexArray(mesh.layout);
  gl.drawElements(gl.TRIANGLES, mesh.count, mesh.kind, 0);
}

const theme = { grid: [0.5, 0.5, 0.5] };
const unit = (rgb) => rgb.map((channel) => channel / 255);

function readTheme() {
  const hex = getComputedStyle(document.documentElement).getPropertyValue("--grid").trim();
  theme.grid = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
  redraw();
}

let waiting = false;
function redraw() {
  if (!waiting) requestAnimationFrame(draw);
  waiting = true;
}

function begin(p, view, project) {
  p.use();
  gl.uniformMatrix4fv(p.slot("view"), false, view);
  gl.uniformMatrix4fv(p.slot("project"), false, project);
}

function draw() {
  waiting = false;
  if (!gl) return;
  const canvas = gl.canvas, ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  gl.viewport(0, 0, width, height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const view = viewMatrix(), project = projection(width / height), shown = state.shown;
  begin(programs.mesh, view, project);
  gl.uniform3fv(programs.mesh.slot("scale"), data.contact_scale.flatMap(unit));
  if (shown.object && scene.object) drawMesh(scene.object, IDENTITY, unit(data.colors.object), 0.03, shown.map && state.mapped);
  if (poses)
    scene.links.forEach((mesh, i) => {
      if (shown[mesh.role]) drawMesh(mesh, poses.subarray(16 * i, 16 * i + 16), unit(mesh.color), 0.16, false);
    });
  if (shown.points && scene.dots.count) {
    begin(programs.dot, view, project);
    gl.uniform1f(programs.dot.slot("size"), Math.max(6, Math.min(14, 6.5 / camera.distance)) * ratio);
    gl.uniform3fv(programs.dot.slot("color"), unit(data.colors.touching));
    gl.bindVertexArray(scene.dots.layout);
    gl.drawArrays(gl.POINTS, 0, scene.dots.count);
  }
  if (shown.grid) drawGrid(view, project);
}

function drawGrid(view, project) {
  begin(programs.grid, view, project);
  gl.enable(gl.BLEND);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.depthMask(false);
  gl.uniform3fv(programs.grid.slot("origin"), [0, 0, data.floor - 0.0005]);
  gl.uniform1f(programs.grid.slot("spread"), 0.3);
  gl.uniform1f(programs.grid.slot("table"), data.table ? 0.22 : 0.0);
  gl.uniform3fv(programs.grid.slot("color"), theme.grid);
  gl.bindVertexArray(scene.grid.layout);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  gl.depthMask(true);
  gl.disable(gl.BLEND);
}

