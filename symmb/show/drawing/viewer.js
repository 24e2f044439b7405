"use strict";
// Viewer of a drawing (see shapes.py for its contents). It needs no network and no library.
//
// All positions are computed here from the numbers of the run, picture by picture; nothing is interpolated.
// Matrices are arrays of 16 numbers, column by column, as WebGL takes them. Vectors are arrays of 3 numbers.

const page = JSON.parse(document.getElementById("drawing").textContent);
const stored = new Float64Array(Uint8Array.from(atob(page.numbers), c => c.charCodeAt(0)).buffer);
const numbers = new Float64Array(page.spare + stored.length);  // first those that a live page computes
numbers.set(stored, page.spare);
let runs = page.live ? page.runs.slice(0, 1) : page.runs, first = runs[0];  // the runs shown: with sliders, one run at a time
const rgb = text => [1, 3, 5].map(i => parseInt(text.slice(i, i + 2), 16) / 255);
const COLOURS = Object.fromEntries(Object.entries(page.colours).map(([name, text]) => [name, rgb(text)]));
const INERTIA = "solid of the same inertia";
const BODIES = page.palette.map(rgb);
const $ = id => document.getElementById(id);

// Vectors and matrices
const Z = [0, 0, 1];
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = a => Math.hypot(a[0], a[1], a[2]);
const unit = a => times(a, 1 / (length(a) || 1));
const columns = (x, y, z, r) => [...x, 0, ...y, 0, ...z, 0, ...r, 1];
const turned = (m, a) => [0, 1, 2].map(i => m[i] * a[0] + m[4 + i] * a[1] + m[8 + i] * a[2]);
const moved = (m, a) => add(turned(m, a), [m[12], m[13], m[14]]);
function across(axis) {  // two unit vectors that make a right-handed frame with an axis
  const u = unit(cross(Math.abs(axis[2]) > 0.9 * length(axis) ? [1, 0, 0] : Z, axis));
  return [u, unit(cross(axis, u))];
}

function rotated(a, axis, angle) {  // Rodrigues
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(times(a, c), times(cross(axis, a), s)), times(axis, dot(axis, a) * (1 - c)));
}

// Numbers of a run
const rowAt = (begin, n) => Array.from(numbers.subarray(begin, begin + n));
const row = (at, k, n) => rowAt(at[0] + Math.min(k, at[1] - 1) * n, n);  // row k of [offset, rows], or the only one
const column = (at, i, n) => Array.from({ length: at[1] }, (_, k) => numbers[at[0] + k * n + i]);

function frameMatrix(run, frame, k) {
  const p = row(run.frames[frame].pose, k, 12);  // [R | r] row by row
  return [p[0], p[4], p[8], 0, p[1], p[5], p[9], 0, p[2], p[6], p[10], 0, p[3], p[7], p[11], 1];
}

function localPosition(run, place, k, scale) {
  const at = run.places[place], base = row(at.base, 0, 3);
  return at.shift ? add(base, times(row(at.shift, k, 3), at.elastic ? scale : 1)) : base;
}

// Meshes: triangles with normals, six numbers a corner
function mesh(corners) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
  return { buffer, count: corners.length / 6 };
}

function surface(rows, columnsOf, point, normal) {  // a grid of points over [0, 1]^2
  const out = [];
  for (let i = 0; i < rows; i++)
    for (let j = 0; j < columnsOf; j++)
      for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) {
        const u = (i + a) / rows, v = (j + b) / columnsOf;
        out.push(...point(u, v), ...normal(u, v));
      }
  return out;
}
const circle = u => [Math.cos(2 * Math.PI * u), Math.sin(2 * Math.PI * u)];

function disc(z, n, sides) {
  const out = [];
  for (let i = 0; i < sides; i++)
    for (const f of [null, i, i + 1]) out.push(...(f === null ? [0, 0] : circle(f / sides)), z, 0, 0, n);
  return out;
}

function tube(points, radius, sides = 6) {  // along a line of points, with open ends
  const rings = points.map((p, i) => {
    const along = unit(sub(points[Math.min(i + 1, points.length - 1)], points[Math.max(i - 1, 0)]));
    const [u, v] = across(along);
    return { p, at: f => { const [c, s] = circle(f); return add(times(u, c), times(v, s)); } };
  });
  const out = [];
  for (let i = 0; i + 1 < rings.length; i++)
    for (let j = 0; j < sides; j++)
      for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) {
        const n = rings[i + a].at((j + b) / sides);
        out.push(...add(rings[i + a].p, times(n, radius)), ...n);
      }
  return out;
}

function faces(polygon) {  // of a flat polygon
  const n = unit(cross(sub(polygon[1], polygon[0]), sub(polygon[2], polygon[0])));
  return polygon.slice(1, -1).flatMap((p, i) => [polygon[0], p, polygon[i + 2]].flatMap(q => [...q, ...n]));
}
const triangles = ([begin, rows]) => Array.from({ length: rows / 3 }, (_, i) => faces([0, 3, 6].map(j => rowAt(begin + 9 * i + j, 3)))).flat();
const line = (n, point) => Array.from({ length: n + 1 }, (_, i) => point(i / n));

function cube() {
  const out = [];
  for (let axis = 0; axis < 3; axis++)
    for (const side of [-1, 1])
      for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]]) {
        const p = [0, 0, 0], n = [0, 0, 0];
        p[axis] = n[axis] = side; p[(axis + 1) % 3] = a; p[(axis + 2) % 3] = b;
        out.push(...p, ...n);
      }
  return out;
}

function meshes() {
  const side = (u, v) => [...circle(u), v], ball = (u, v) => {
    const [c, s] = circle(u), angle = Math.PI * v;
    return [c * Math.sin(angle), s * Math.sin(angle), -Math.cos(angle)];
  };
  const drum = n => mesh([...surface(n, 1, side, u => [...circle(u), 0]), ...disc(0, -1, n), ...disc(1, 1, n)]);
  return {
    cylinder: drum(18), bar: drum(18), drum: drum(48),
    cone: mesh([...surface(20, 1, (u, v) => [...times([...circle(u), 0], 1 - v).slice(0, 2), v],
                           u => [...circle(u), 0.5]), ...disc(0, -1, 20)]),
    ball: mesh(surface(24, 12, ball, ball)), cap: mesh(surface(14, 8, ball, ball)),
    box: mesh(cube()),
  };
}

// What is seen: parts, each a mesh with a matrix and a colour
const parts = [];
let current = { run: null, shape: null }, scale = 1;

function part(of, matrix, faint = current.shape.faint) {
  parts.push({ mesh: of, matrix, faint, run: current.run, shape: current.shape });
}

const ball = (a, r, of = built.ball) => part(of, columns([r, 0, 0], [0, r, 0], [0, 0, r], a));

const dynamic = corners => part(Object.assign(mesh(corners), { passing: true }), IDENTITY);  // of this picture alone

function axesOf(kind, at, d, half) {  // x, y and z of a part; see forms.py
  if (kind === "world") return [[1, 0, 0], [0, 1, 0], Z];
  if (kind === "half") return half;
  if (kind === "ends") { const along = sub(at[1], at[0]); return [...across(length(along) ? along : Z), along]; }
  const w = unit(d), u = first.planar && Math.abs(w[2]) < 0.5 ? Z : across(w)[0], v = cross(w, u);
  return kind === "scaled" ? [v, w, u].map(a => times(a, length(d))) : [u, v, w];
}

function solid(of, [x, y, z], [a, b, c], origin) {
  part(of, columns(times(x, a), times(y, b), times(z, c), origin));
}

function place(it, at, d, half) {  // a part of a shape
  const axes = axesOf(it.axes, at, d, half), frame = columns(...axes, at[0]), origin = moved(frame, it.at);
  if (it.what === "arrow") {
    const [radius, wide, long] = it.size, size = length(d), head = Math.min(long, size);
    if (size < radius) return;
    solid(built.cylinder, axes, [radius, radius, size - head], origin);
    solid(built.cone, axes, [wide, wide, head], moved(frame, [0, 0, size - head]));
  } else if (it.what === "line") {
    it.line ??= Array.from({ length: it.points[1] }, (_, i) => rowAt(it.points[0] + 3 * i, 3));
    if (it.axes !== "ends") part(it.mesh ??= mesh(tube(it.line, it.size[0])), frame);
    else dynamic(tube(it.line.map(p => moved(frame, p)), it.size[0], it.line.length > 2 ? 5 : 18));
  } else {
    solid(built[it.what], axes, it.size, origin);
    if (it.what === "bar") at.forEach(p => ball(p, it.size[0], built.cap));
  }
}

const forms = {  // forms that only follow their places
  mesh: (at, shape, run, m) => part(shape.mesh ??= mesh(triangles(shape.direction)), m),
  curve: (at, shape) => dynamic(tube(at, shape.size[0])),
  plate: at => dynamic(faces(at)),
  path: (at, shape, run) => dynamic(tube(line(run.t[1] - 1, u =>
    position(run, shape.places[0], Math.round(u * (run.t[1] - 1)))), shape.size[0], 4)),
};
function position(run, place, k) {
  return moved(frameMatrix(run, run.places[place].frame, k), localPosition(run, place, k, scale));
}

function arrange(k) {  // all parts of picture k
  for (const old of parts) if (old.mesh.passing) gl.deleteBuffer(old.mesh.buffer);
  parts.length = 0;
  runs.forEach((run, number) => {
    if (number && !$("ghosts").checked) return;
    const matrices = run.frames.map((_, i) => frameMatrix(run, i, k));
    for (const shape of run.shapes) {
      if (number && page.nominal.includes(shape.colour)) continue;
      if (shape.kind === INERTIA && !$("solids").checked) continue;
      if (shape.present && row(shape.present, k, 1)[0] < 0.5) continue;
      current = { run: number, shape };
      const m = matrices[run.places[shape.places[0]].frame];
      const at = shape.places.map(p => moved(matrices[run.places[p].frame], localPosition(run, p, k, scale)));
      const local = shape.direction ? row(shape.direction, k, shape.form === "solid" ? 9 : 3) : [0, 0, 1];
      const axes = [0, 3, 6].map(j => shape.in_world ? local : turned(m, local.slice(j, j + 3)));  // half axes of solids
      forms[shape.form]?.(at, shape, run, m);
      for (const it of shape.parts) place(it, at, axes[0], axes);
    }
  });
  const region = page.region;
  if (region && $("ghosts").checked) {
    current = { run: 0, shape: { name: region.name, kind: "position over the box", colour: "trace", faint: false } };
    const points = row(region.points, k, 3 * region.count);
    for (let i = 0; i < region.count; i++) ball(points.slice(3 * i, 3 * i + 3), 0.6 * first.unit);
  }
}

// Drawing with WebGL
const trial = document.createElement("canvas").getContext("webgl2"), info = trial?.getExtension("WEBGL_debug_renderer_info");
const drawnBySoftware = info && /swiftshader|llvmpipe|software/i.test(trial.getParameter(info.UNMASKED_RENDERER_WEBGL));
const canvas = $("view"), gl = canvas.getContext("webgl2", { alpha: false, antialias: !drawnBySoftware });
if (!gl) $("message").textContent = "This browser does not support WebGL. Open the page in another browser.";

const VERTEX = `#version 300 es
in vec3 corner; in vec3 normal; uniform mat4 model, camera; uniform mat3 turn; out vec3 n;
void main() { n = turn * normal; gl_Position = camera * (model * vec4(corner, 1.0)); }`;
const LIGHT = page.light;
const FRAGMENT = `#version 300 es
precision highp float; in vec3 n; uniform vec4 colour; uniform mat3 view; uniform bool flat_colour; out vec4 pixel;
void main() {
  if (flat_colour) { pixel = colour; return; }
  vec3 d = view * normalize(n);
  if (d.z < 0.0) d = -d;
  float light = ${LIGHT.everywhere} + ${LIGHT.lit} * max(dot(d, normalize(vec3(${LIGHT.direction}))), 0.0) + ${LIGHT.in_front} * d.z;
  vec3 shine = vec3(0.22) * pow(max(dot(d, normalize(vec3(-0.2, 0.35, 0.9))), 0.0), 24.0);
  pixel = vec4(colour.rgb * light + shine, colour.a);
}`;

function program() {
  const it = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) console.error(gl.getShaderInfoLog(shader));
    gl.attachShader(it, shader);
  }
  ["corner", "normal"].forEach((name, i) => gl.bindAttribLocation(it, i, name));
  gl.linkProgram(it); gl.useProgram(it);
  const at = name => gl.getUniformLocation(it, name);
  for (const attribute of [0, 1]) gl.enableVertexAttribArray(attribute);
  gl.enable(gl.DEPTH_TEST);
  return { model: at("model"), camera: at("camera"), turn: at("turn"), view: at("view"), colour: at("colour"), flat: at("flat_colour") };
}

// The camera looks along -axes[2]; `centre` is in the middle, `height` is that of the canvas in metres.
const view = { axes: [0, 1, 2].map(i => first.camera.slice(3 * i, 3 * i + 3)), up: first.up, centre: [0, 0, 0], height: 1, depth: 1 };

function cameraMatrix() {
  const [x, y, z] = view.axes, h = 2 / view.height, w = h * canvas.height / canvas.width, d = 1 / view.depth;
  const turn = [0, 1, 2].flatMap(i => [w * x[i], h * y[i], -d * z[i], 0]);
  return [...turn, -w * dot(x, view.centre), -h * dot(y, view.centre), d * dot(z, view.centre), 1];
}

function fit() {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const include = (p, margin) => view.axes.map(axis => dot(axis, p)).forEach((x, i) =>
    [low[i], high[i]] = [Math.min(low[i], x - margin), Math.max(high[i], x + margin)]);
  for (const run of page.runs) {
    const n = run.t[1], step = Math.max(1, Math.floor(n / (page.sliders.length ? 8 : 60)));
    for (let k = 0; k < n; k += step)
      for (const shape of run.shapes)
        for (const place of shape.places) {
          const tip = shape.form === "arrow" ? row(shape.direction, k, 3) : [0, 0, 0], p = add(position(run, place, k), tip);
          include(p, shape.form === "solid" ? Math.hypot(...row(shape.direction, 0, 9)) / 1.2
            : shape.form === "twist" ? length(row(shape.direction, k, 3))
              : ["ball", "ring", "mesh"].includes(shape.form) ? shape.size[0] : 4 * first.unit);
        }
  }
  for (let i = 0, r = page.region; i < r?.points[1] * r?.count; i++) include(rowAt(r.points[0] + 3 * i, 3), 0.6 * first.unit);
  for (let i = 0; i < swept?.[1]; i++) include([...rowAt(swept[0] + 2 * i, 2), 0], 0);
  if (low[0] > high[0]) { low.fill(-1); high.fill(1); }
  low[1] -= (high[1] - low[1]) / (Math.max(canvas.height / 84 / devicePixelRatio, 3.3) - 1);  // room for arrows and the scale
  view.centre = view.axes.reduce((sum, axis, i) => add(sum, times(axis, (low[i] + high[i]) / 2)), [0, 0, 0]);
  view.height = 1.12 * Math.max(high[1] - low[1], (high[0] - low[0]) * canvas.height / canvas.width);
  view.depth = 4 * Math.max(high[2] - low[2], high[1] - low[1], high[0] - low[0]);
}

function colourOf({ run, shape, faint }) {
  const tint = runs[run].tint, own = COLOURS[shape.colour] ?? BODIES[Number(shape.colour) % BODIES.length];
  return tint ? [...rgb(tint), faint ? 0.08 : 0.34] : [...own, faint ? 0.26 : 1];
}

function drawPart(it, colour, mode = gl.TRIANGLES) {
  gl.uniform4fv(uniforms.colour, colour);
  const m = it.matrix, x = m.slice(0, 3), y = m.slice(4, 7), z = m.slice(8, 11);
  gl.uniformMatrix4fv(uniforms.model, false, m);
  gl.uniformMatrix3fv(uniforms.turn, false, [...cross(y, z), ...cross(z, x), ...cross(x, y)].map(c => c / (first.size ** 2)));
  gl.bindBuffer(gl.ARRAY_BUFFER, it.mesh.buffer);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 24, 0);
  gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 24, 12);
  gl.drawArrays(mode, 0, it.mesh.count);
}

function begin(background) {
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(...background);
  gl.depthMask(true); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.uniformMatrix4fv(uniforms.camera, false, cameraMatrix());
  const [x, y, z] = view.axes;
  gl.uniformMatrix3fv(uniforms.view, false, [0, 1, 2].flatMap(i => [x[i], y[i], z[i]]));
}

function render() {
  begin([1, 1, 1, 1]);
  gl.uniform1i(uniforms.flat, 0);
  if (sweep && $("ghosts").checked) {  // below all other parts
    gl.uniform1i(uniforms.flat, 1);
    gl.disable(gl.DEPTH_TEST);
    drawPart(sweep, [...COLOURS.region, 1]);
    drawPart(outline, [...COLOURS.region, 1], gl.LINES);  // a region may be thinner than a pixel
    gl.enable(gl.DEPTH_TEST);
    gl.uniform1i(uniforms.flat, 0);
  }
  const coloured = parts.map(it => [it, colourOf(it)]);
  gl.disable(gl.BLEND);
  for (const [it, colour] of coloured) if (colour[3] === 1) drawPart(it, colour);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.depthMask(false);
  for (const [it, colour] of coloured) if (colour[3] < 1) drawPart(it, colour);
  overlay();
}

function pick(x, y) {  // the shape at a pixel of the canvas, from its upper left corner
  gl.enable(gl.SCISSOR_TEST);
  gl.scissor(x, canvas.height - 1 - y, 1, 1);
  begin([0, 0, 0, 0]);
  gl.disable(gl.BLEND);
  gl.uniform1i(uniforms.flat, 1);
  parts.forEach((it, i) => { if (!it.faint) drawPart(it, [((i + 1) & 255) / 255, ((i + 1) >> 8) / 255, 0, 1]); });
  const pixel = new Uint8Array(4);
  gl.readPixels(x, canvas.height - 1 - y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  gl.disable(gl.SCISSOR_TEST);
  return parts[pixel[0] + 256 * pixel[1] - 1] ?? null;
}

function project(p) {  // pixel of the canvas, from its upper left corner
  const q = moved(cameraMatrix(), p);
  return [(q[0] + 1) / 2 * canvas.width, (1 - q[1]) / 2 * canvas.height];
}

// Axes, gravity and scale, over the lower edge of the picture: drawn anew only if the camera has moved
let overlaid = "";
function overlay() {
  const c = $("overlay"), pen = c.getContext("2d"), ratio = devicePixelRatio, w = c.width / ratio, h = c.height / ratio;
  const seen = String([view.axes, view.height, c.width, canvas.height]);
  if (overlaid === seen) return;
  overlaid = seen;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0); pen.clearRect(0, 0, w, h);
  pen.font = "12px system-ui, sans-serif"; pen.lineWidth = 2;
  const arrow = (x, y, dx, dy, text) => {
    const size = Math.hypot(dx, dy);
    pen.strokeStyle = pen.fillStyle = page.colours[text];
    if (size > 5) {
      const ux = dx / size, uy = dy / size;
      pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + dx - 5 * ux, y + dy - 5 * uy); pen.stroke();
      pen.beginPath(); pen.moveTo(x + dx, y + dy); pen.lineTo(x + dx - 8 * ux - 3.5 * uy, y + dy - 8 * uy + 3.5 * ux);
      pen.lineTo(x + dx - 8 * ux + 3.5 * uy, y + dy - 8 * uy - 3.5 * ux); pen.fill();
      pen.fillText(text, x + dx + 8 * ux - 4, y + dy + 8 * uy + 4);
    } else if (!first.planar) pen.fillText(text, x + dx + 6, y + dy);
  };
  const [X, Y] = view.axes, o = [52, h - 60];
  [..."xyz"].forEach((text, i) => arrow(...o, 34 * X[i], -34 * Y[i], text));
  const g = times(unit(first.gravity), 28);
  if (length(g)) arrow(122, h - 60, dot(X, g), -dot(Y, g), "g");
  const metre = canvas.height / ratio / view.height, nice = roundBelow(140 / metre), x = w - 24 - nice * metre, y = h - 24;
  pen.strokeStyle = pen.fillStyle = page.colours.scale; pen.lineWidth = 1.5;
  pen.beginPath(); pen.moveTo(x, y - 5); pen.lineTo(x, y); pen.lineTo(w - 24, y); pen.lineTo(w - 24, y - 5); pen.stroke();
  pen.textAlign = "center"; pen.fillText(lengthText(nice), (x + w - 24) / 2, y - 6); pen.textAlign = "left";
}

function roundBelow(most) {  // the largest of 1, 2 and 5 times a power of ten
  const power = 10 ** Math.floor(Math.log10(most) + 1e-9);
  return [5, 2, 1].map(f => f * power).find(f => f <= most * (1 + 1e-9));
}
const lengthText = a => a >= 1 ? `${+a.toPrecision(3)} m` : a >= 1e-3 ? `${+(1e3 * a).toPrecision(3)} mm` : `${+(1e6 * a).toPrecision(3)} µm`;

// Curves of the outputs
const curves = [];
function makeCurves() {
  first.outputs.forEach((name, i) => {
    const box = document.createElement("div"), c = document.createElement("canvas"), cursor = document.createElement("i");
    const head = document.createElement("p"), value = document.createElement("b");
    head.append(name, value); box.append(head, c, cursor); c.role = "img"; c.ariaLabel = `${name} over time`;
    const share = e => (e.clientX - c.getBoundingClientRect().left) / c.clientWidth;
    box.onpointerdown = box.onpointermove = e => { if (e.buttons) seek(nearest(first, times0() + share(e) * span())); };
    $("curves").append(box);
    curves.push({ i, c, cursor, value });
  });
}
const times0 = () => numbers[first.t[0]], span = () => (numbers[first.t[0] + first.t[1] - 1] - times0()) || 1;
function rangeOf(columns) {
  let low = Infinity, high = -Infinity;
  for (const y of columns.flat().filter(Number.isFinite)) { low = Math.min(low, y); high = Math.max(high, y); }
  return high - low > 1e-12 * Math.max(Math.abs(low), Math.abs(high)) ? [low, high] : [low - 1, high + 1];
}

function drawCurves(chosen = curves) {
  const n = first.outputs.length, t = column(first.t, 0, 1), sheet = new OffscreenCanvas(1, 1), pen = sheet.getContext("2d"), by = roundBelow(span() / 4);
  for (const curve of chosen) {
    const { i, c } = curve, w = sheet.width = c.clientWidth * devicePixelRatio, foot = 14 * devicePixelRatio, h = (sheet.height = c.clientHeight * devicePixelRatio) - foot;
    const lines = runs.map(run => ({ values: column(run.values, i, n), tint: run.tint || page.palette[0] }));
    const bounds = page.bounds && [page.bounds.lower, page.bounds.upper].map(at => column(at, i, n));
    const [low, high] = curve.range ??= rangeOf([...page.runs.map(run => column(run.values, i, n)), ...(bounds || [])]);
    const room = 14 * devicePixelRatio, x = k => t.length > 1 ? (t[k] - t[0]) / span() * w : k * w, y = v => h - room - (v - low) / (high - low) * (h - 2 * room);
    const whole = values => t.length > 1 ? values : [values[0], values[0]];  // a single time has a level line
    const path = values => whole(values).forEach((v, k) => pen.lineTo(x(k), y(v)));
    if (bounds) {
      pen.beginPath(); path(bounds[0]);
      for (let k = Math.max(t.length - 1, 1); k >= 0; k--) pen.lineTo(x(k), y(whole(bounds[1])[k]));
      pen.fillStyle = "#d8e3ee"; pen.fill();
    }
    pen.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
    for (let tick = Math.ceil(t[0] / by - 1e-9) * by; t.length > 1 && tick <= t[0] + span() + 1e-9 * by; tick += by) {
      const at = (tick - t[0]) / span() * w, text = `${+(Math.round(tick / by) * by).toPrecision(6)}${tick + by > t[0] + span() + 1e-9 * by ? " s" : ""}`, wide = pen.measureText(text).width;
      pen.fillStyle = "#e3e7eb"; pen.fillRect(Math.min(at, w - 1), 0, 1, h);
      pen.fillStyle = "#4b5563"; pen.fillText(text, Math.min(Math.max(at - wide / 2, 0), w - wide), h + foot - 3 * devicePixelRatio);
    }
    if (low < 0 && high > 0) { pen.fillStyle = "#c3cad2"; pen.fillRect(0, y(0), w, 1); }
    for (const level of curve.levels ?? [])  // limits of a live page
      if (level >= low && level <= high) { pen.fillStyle = "#b91c1c"; pen.fillRect(0, y(level), w, 1); }
    for (const { values, tint } of lines) {
      pen.beginPath(); path(values);
      pen.strokeStyle = tint; pen.lineWidth = 1.4 * devicePixelRatio; pen.stroke();
    }
    if (bounds && page.mark?.output === i) {
      pen.fillStyle = "#b91c1c"; pen.fillRect(x(nearest(first, page.mark.time)) - 1, 0, 2, h);
    }
    pen.fillStyle = "#4b5563";
    for (const [v, at] of [[high, 10 * devicePixelRatio], [low, h - 3 * devicePixelRatio]]) pen.fillText(short(v), 3, at);
    c.getContext("bitmaprenderer").transferFromImageBitmap(sheet.transferToImageBitmap());
  }
}
const short = v => Number.isNaN(v) ? "\u2013" : !v || Math.abs(v) >= 1e-3 && Math.abs(v) < 1e5 ? String(+v.toPrecision(4)) : v.toExponential(2);

// Sliders: each place is a run
function makeSliders() {
  for (const slider of page.sliders) {
    const label = document.createElement("label"), input = document.createElement("input");
    slider.shown = document.createElement("output");
    Object.assign(input, { type: "range", min: 0, max: slider.values.length - 1, value: slider.at });
    input.oninput = () => { slider.at = Number(input.value); choose(); drawCurves(); show(); };
    label.append(slider.name, input, slider.shown);
    $("sliders").append(label);
  }
  if (page.sliders.length) choose();
}

function choose() {
  for (const { shown, values, at } of page.sliders) shown.textContent = short(values[at]);
  runs = [page.runs[page.sliders.reduce((k, { values, at }) => k * values.length + at, 0)]];
  first = runs[0];
}

// Time
let picture = 0, clock = 0, playing = false, previous = 0, drawn = 0;
function nearest(run, t) {  // the picture whose time is closest
  const at = k => numbers[run.t[0] + k];
  let low = 0, high = run.t[1] - 1;
  while (high - low > 1) at((low + high) >> 1) <= t ? low = (low + high) >> 1 : high = (low + high) >> 1;
  return t - at(low) <= at(high) - t ? low : high;
}

function seek(k) {
  [picture, clock] = [k, numbers[first.t[0] + k]];
  show();
}

function show() {
  arrange(picture);
  render();
  drawn += 1;
  if (playing && drawn % 4) return;  // the surroundings are redrawn fifteen times a second only
  const n = first.outputs.length, t = numbers[first.t[0] + picture], wide = curves.length && curves[0].c.clientWidth;
  $("scrub").value = picture;
  $("time").textContent = `${t.toPrecision(5)} s`;
  for (const { i, cursor, value } of curves) {
    cursor.style.transform = `translateX(${(t - times0()) / span() * wide}px)`;
    value.textContent = short(numbers[first.values[0] + picture * n + i]);
  }
}

function tick(now) {
  if (!playing) return;
  clock += Math.min(Math.max(now - previous, 0), 100) / 1000 * Number($("speed").value);  // the first frame can be older than its request
  previous = now;
  if (clock > times0() + span()) clock = times0();
  picture = nearest(first, clock);
  show();
  requestAnimationFrame(tick);
}

function play(on) {
  if (!playing && on) { previous = performance.now(); requestAnimationFrame(tick); }
  playing = on && first.t[1] > 1;
  if (!playing) show();
  $("play").textContent = playing ? "\u275a\u275a" : "\u25b6";
}

// Input of the user
function follow() {  // the address: #t=4.2, or #play
  const address = new URLSearchParams(location.hash.slice(1)), t = Number(address.get("t") ?? NaN);
  if (Number.isFinite(t)) { play(false); seek(nearest(first, t)); }
  if (address.has("play")) play(true);
  return Number.isFinite(t) || address.has("play");
}

function resize() {
  const pixels = length => Math.max(1, Math.round(length * devicePixelRatio));
  for (const c of [canvas, $("overlay")]) [c.width, c.height] = [pixels(c.clientWidth), pixels(c.clientHeight)];
  overlaid = ""; drawCurves(); fit(); show();
}

function drag(right, down, shifts) {  // turn the view, or shift it; views of the plane are only shifted by default
  if (shifts !== first.planar) {
    const metre = view.height / canvas.clientHeight, [x, y] = view.axes;
    view.centre = add(view.centre, add(times(x, -right * metre), times(y, down * metre)));
  } else {
    const around = axis => angle => view.axes.map(a => rotated(a, axis, angle));
    view.axes = around(unit(view.up))(-0.008 * right);
    view.axes = around(view.axes[0])(-0.008 * down);
  }
  show();
}

function hover(e) {
  const ratio = devicePixelRatio, it = pick(Math.round(e.offsetX * ratio), Math.round(e.offsetY * ratio)), tip = $("tip");
  render();
  tip.hidden = !it;
  if (!it) return;
  tip.textContent = `${it.shape.name} \u2013 ${it.shape.kind}${runs[it.run].tint ? `, ${runs[it.run].label}` : ""}`;
  Object.assign(tip.style, { left: 0, top: `${e.offsetY + 10}px` });
  tip.style.left = `${Math.max(0, Math.min(e.offsetX + 14, canvas.clientWidth - tip.offsetWidth))}px`;
}

function listen() {
  let asked = 0;
  const pressed = new Map();  // the last events of the mouse or the fingers that press the canvas
  canvas.onpointerdown = e => { canvas.setPointerCapture(e.pointerId); pressed.set(e.pointerId, e); };
  canvas.onpointerup = canvas.onpointercancel = e => pressed.delete(e.pointerId);
  canvas.onpointermove = e => {
    const before = pressed.get(e.pointerId), other = [...pressed.values()].find(own => own.pointerId !== e.pointerId);
    if (before) {
      const right = e.clientX - before.clientX, down = e.clientY - before.clientY;
      const apart = own => Math.hypot(own.clientX - other.clientX, own.clientY - other.clientY) || 1;
      pressed.set(e.pointerId, e);
      if (other) view.height *= apart(before) / apart(e);
      if (other) drag(right / 2, down / 2, !first.planar);
      else drag(right, down, Boolean((e.buttons & 2) || e.shiftKey));
    } else if (performance.now() - asked > 60) { asked = performance.now(); hover(e); }
  };
  canvas.onclick = hover;  // a finger cannot hover
  canvas.onpointerleave = () => { $("tip").hidden = true; };
  canvas.oncontextmenu = e => e.preventDefault();
  canvas.ondblclick = () => { view.axes = [0, 1, 2].map(i => first.camera.slice(3 * i, 3 * i + 3)); fit(); show(); };
  canvas.addEventListener("wheel", e => { e.preventDefault(); view.height *= Math.exp(0.0012 * e.deltaY); show(); }, { passive: false });
  $("play").onclick = () => play(!playing);
  $("scrub").oninput = e => { play(false); seek(Number(e.target.value)); };
  $("scale").oninput = e => { scale = Number(e.target.value); $("scaled").textContent = `\u00d7${scale}`; show(); };
  $("ghosts").onchange = $("solids").onchange = show;
  document.onkeydown = e => {
    const on = elements => e.target.matches(elements), by = { "+": 1 / 1.1, "-": 1.1 }[e.key];
    const [right, down] = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowDown: [0, 1], ArrowUp: [0, -1] }[e.key] ?? [0, 0];
    if (e.key === " " && !on("button, select, input:not([type=range])")) { e.preventDefault(); play(!playing); }
    if (e.ctrlKey || e.metaKey || e.altKey || on("input, select")) return;
    if (by) { view.height *= by; show(); }
    else if (e.shiftKey && (right || down)) drag(20 * right, 20 * down, false);
    else if (right) seek(Math.min(Math.max(picture + right, 0), first.t[1] - 1));
  };
  addEventListener("hashchange", follow);
  addEventListener("resize", resize);
}

const uniforms = program(), built = meshes();
const swept = page.region?.sweep, IDENTITY = columns([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]);
const covering = of => ({ mesh: mesh(Array.from({ length: swept[1] }, (_, k) => of(k)).flat().flatMap(k => [...rowAt(swept[0] + 2 * k, 2), 0, 0, 0, 1])), matrix: IDENTITY });
const [sweep, outline] = swept?.[1] ? [covering(k => [k]), covering(k => [k, k % 3 < 2 ? k + 1 : k - 2])] : [];
makeSliders();
$("scrub").max = first.t[1] - 1; $("speed").value = page.speed;
$("elastic").hidden = !first.places.some(p => p.elastic);
$("several").hidden = runs.length < 2 && !page.region;
$("inertia").hidden = !first.shapes.some(s => s.kind === INERTIA);
makeCurves(); listen(); resize();
if (!follow()) { seek(page.picture); play(!page.mark); }
window.symmb = { seek, pick, project, play, frameMatrix: i => frameMatrix(first, i, picture), drawn: () => drawn, parts: () =>
  parts.map(p => ({ name: p.shape.name, kind: p.shape.kind, form: p.shape.form, run: p.run, matrix: p.matrix })) };
