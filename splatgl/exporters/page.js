// Draws a page's splats in WebGL 2 as splatgl draws them in OpenGL: instanced quads from back to front, in half floats.
// `scene` and `shaders` are JSON in the page; the splats are deflated planes of bytes, see splatgl/splat/quantized.py.
// Matrices are arrays of rows; eye axes are right, down, forward; positions of splats are steps of the grid.
"use strict";

// ---- vectors and matrices

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const apply = (m, v) => m.map((row) => dot(row, v));
const transposed = (m) => [0, 1, 2].map((i) => m.map((row) => row[i]));
const product = (a, b) => a.map((row) => transposed(b).map((column) => dot(row, column)));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (v) => v.map((x) => x / Math.sqrt(dot(v, v)));

function inverse(m) {
  const rows = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
  const size = dot(m[0], rows[0]);
  return transposed(rows).map((row) => row.map((x) => x / size));
}

// Rows right, down, forward turned about an axis, in eye axes, by an angle.
function turned(axes, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const spin = [0, 1, 2].map((i) => {
    const e = [0, 1, 2].map((j) => +(i === j));
    return add(add(e.map((x) => x * c), cross(axis, e), s), axis, dot(axis, e) * (1 - c));
  });
  return product(spin, axes).map(unit);
}

// ---- splats

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The words of all splats, four each, in rows of a texture, from planes of their bytes.
function unpackSplats(planes, count, row) {
  const rows = Math.max(1, Math.ceil(count / row)), bytes = new Uint8Array(rows * row * 16);
  for (let at = 0; at < 16; at++) for (let n = 0; n < count; n++) bytes[16 * n + at] = planes[at * count + n];
  for (let n = 0; n < count; n++) bytes[16 * n + 6] ^= bytes[16 * n + 7];
  const halves = new Uint16Array(bytes.buffer);
  for (let n = 1; n < count; n++) for (let k = 0; k < 3; k++) halves[8 * n + k] += halves[8 * n - 8 + k];
  return { words: new Uint32Array(bytes.buffer), halves, rows };
}

// Orders splats by their planes across an axis, rows in them, and cells in rows, once: a counting sort of each key.
function latticeAcross(halves, count, axis) {
  const keys = [0, 1, 2].filter((other) => other !== axis).concat(axis);
  let order = Uint32Array.from({ length: count }, (_, n) => n);
  for (const key of keys) {
    const starts = new Uint32Array(65537), next = new Uint32Array(count);
    for (let n = 0; n < count; n++) starts[halves[8 * n + key] + 1]++;
    for (let n = 0; n < 65536; n++) starts[n + 1] += starts[n];
    for (const n of order) next[starts[halves[8 * n + key]]++] = n;
    order = next;
  }
  const [inner, middle, outer] = keys;
  const starts = (members, keyed) => {
    const begins = [];
    for (let n = 0; n < members; n++) if (!n || keyed(n) !== keyed(n - 1)) begins.push(n);
    return Uint32Array.from([...begins, members]);
  };
  const key = (which) => (n) => halves[8 * order[n] + which];
  const rows = starts(count, (n) => key(outer)(n) * 65536 + key(middle)(n));
  const planes = starts(rows.length - 1, (n) => key(outer)(rows[n]));
  return { order, rows, planes, inner, middle, outer };
}

// Writes the splats from back to front into `into`, as seen from a place in steps: along each axis first those before the
// eye, ascending, then those beyond it, descending. kept: of the number of a splat. Returns how many there are.
function orderSplats(lattice, halves, eye, kept, into) {
  const { order, rows, planes, inner, middle, outer } = lattice;
  let count = 0;
  const walk = (first, last, at, limit, visit) => {
    let split = first;
    while (split < last && at(split) <= limit) visit(split++);
    for (let n = last - 1; n >= split; n--) visit(n);
  };
  const splat = (n) => halves[8 * order[n] + inner];
  const row = (n) => halves[8 * order[rows[n]] + middle];
  const plane = (n) => halves[8 * order[rows[planes[n]]] + outer];
  walk(0, planes.length - 1, plane, eye[outer], (p) =>
    walk(planes[p], planes[p + 1], row, eye[middle], (r) =>
      walk(rows[r], rows[r + 1], splat, eye[inner], (n) => {
        if (kept(order[n])) into[count++] = order[n];
      })));
  return count;
}

// ---- cameras

// The block Frame of shaders/frame.glsl as float32: what splatgl/gl/features.py writes. layout: offsets of its fields.
function frameBlock(camera, grid, layout, size, extentOf) {
  const [width, height] = size, block = new Float32Array(layout.size / 4);
  const a = product(camera.axes, grid.matrix).map((row) => row.map((x) => x / grid.spacing));
  const eye = apply(inverse(grid.matrix), add(camera.eye, grid.origin, -1));
  const base = eye.map((x, k) => Math.min(Math.max(Math.round(x), 0), grid.last[k]));
  const pitch = extentOf(camera, size) / height / (camera.perspective ? 1 : grid.spacing);
  const put = (name, values) => block.set(values, layout.offsets[name] / 4);
  const matrix = (name, m) => transposed(m).forEach((column, n) => block.set(column, layout.offsets[name] / 4 + 4 * n));
  matrix("eye_from_index", a);
  matrix("index_from_eye", inverse(a));
  matrix("eye_from_world", camera.axes);
  put("base", base);
  put("eye_from_base", apply(a, add(eye, base, -1)));
  put("clip_scale", [2 / (width * pitch), 2 / (height * pitch)]);
  put("pixel_pitch", [pitch]);
  put("near", [layout.near]);
  put("image_center", [width / 2, height / 2]);
  put("blur", [1]);
  return { block, eye, pitch };
}

// ---- the table of values

// Linear RGB and optical depth of a layer's table, its opacity times a factor and its values moved by a share of the range.
function classified(base, factor, shift) {
  const last = base.length / 4 - 1, table = new Float32Array(base.length);
  for (let n = 0; n <= last; n++) {
    const at = Math.min(Math.max(n - shift * last, 0), last), low = Math.min(Math.floor(at), last - 1), part = at - low;
    for (let k = 0; k < 4; k++) table[4 * n + k] = base[4 * low + k] * (1 - part) + base[4 * low + 4 + k] * part;
    table[4 * n + 3] *= factor;
  }
  return table;
}

const srgb = (x) => 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
const cssColor = (rgb) => `rgb(${rgb.map((x) => Math.round(srgb(Math.min(Math.max(x, 0), 1)))).join(",")})`;

// ---- WebGL

class Painter {
  // canvas: whose context draws; throws an Error without WebGL 2 or half floats.
  constructor(canvas, scene, shaders, splats) {
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true }));
    if (!gl) throw new Error("WebGL 2 is not available");
    if (!gl.getExtension("EXT_color_buffer_float") && !gl.getExtension("EXT_color_buffer_half_float"))
      throw new Error("half-float targets are not available");
    Object.assign(this, { scene, splats, programs: {} });
    this.order = new Uint32Array(scene.count);
    this.lattices = [0, 1, 2].map((axis) => latticeAcross(splats.halves, scene.count, axis));
    this.shaders = shaders;
    this.screen = this.compiled(shaders.screen);
    this.splatTexture = this.texture(gl.RGBA32UI, scene.row, splats.rows, gl.RGBA_INTEGER, gl.UNSIGNED_INT, splats.words);
    const side = scene.footprint.length, footprint = new Float32Array(side * side);
    footprint.forEach((_, n) => {
      // radial values at squared distances from 0 to R²: the square of the table's half side
      const [x, y] = [n % side, Math.floor(n / side)].map((k) => ((k + 0.5) / side) * 2 - 1);
      const at = Math.min(x * x + y * y, 1) * (side - 1), low = Math.min(Math.floor(at), side - 2);
      footprint[n] = scene.footprint[low] * (1 - at + low) + scene.footprint[low + 1] * (at - low);
    });
    this.footprint = this.texture(gl.R16F, side, side, gl.RED, gl.FLOAT, footprint, gl.LINEAR);
    this.tables = scene.layers.map((layer) => new Float32Array(bytesOf(layer.table).buffer));
    this.classes = this.texture(gl.RGBA32F, scene.classes, scene.layers.length, gl.RGBA, gl.FLOAT, null);
    this.classify(1, 0);
    this.instances = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, 4 * Math.max(scene.count, 1), gl.DYNAMIC_DRAW);
    this.blocks = [scene.frame.size, 0].map(() => gl.createBuffer());
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.blocks[1]);
    gl.bufferData(gl.UNIFORM_BUFFER, bytesOf(scene.style), gl.STATIC_DRAW);
    this.target = gl.createFramebuffer();
    this.size = [0, 0];
    this.cut = { axis: -1, low: 0, high: 65535 };
  }

  compiled([vertex, fragment]) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.bindAttribLocation(program, 0, "in_first");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    ["Frame", "Style"].forEach((name, binding) => {
      const block = gl.getUniformBlockIndex(program, name);
      if (block !== gl.INVALID_INDEX) gl.uniformBlockBinding(program, block, binding);
    });
    return program;
  }

  texture(form, width, height, layout, type, data, filter = this.gl.NEAREST) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, form, width, height, 0, layout, type, data);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  // Opacity times a factor, values moved by a share of the range: of all layers.
  classify(factor, shift) {
    const gl = this.gl, { classes, layers } = this.scene, all = new Float32Array(4 * classes * layers.length);
    this.shown = this.tables.map((table, n) => classified(table, factor, layers[n].own ? 0 : shift));
    this.shown.forEach((table, n) => all.set(table, 4 * classes * n));
    gl.bindTexture(gl.TEXTURE_2D, this.classes);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, classes, layers.length, gl.RGBA, gl.FLOAT, all);
  }

  resize(size) {
    if (size[0] === this.size[0] && size[1] === this.size[1]) return;
    const gl = this.gl;
    gl.deleteTexture(this.picture);
    this.size = size;
    this.picture = this.texture(gl.RGBA16F, ...size, gl.RGBA, gl.HALF_FLOAT, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.picture, 0);
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE)
      throw new Error("half-float targets are not available");
  }

  // Uploads the order of the splats unless the eye is in the same cell and sees the same planes.
  sort(camera, eye) {
    const gl = this.gl, { grid, step, count } = this.scene, back = inverse(grid.matrix);
    const view = apply(back, camera.axes[2]);
    const across = view.map((x, k) => Math.abs(x) / Math.sqrt(dot(back[k], back[k])));
    const axis = [2, 1, 0].reduce((best, k) => (across[k] > across[best] ? k : best), 2);
    const steps = camera.perspective ? eye.map((x) => Math.floor(x / step)) : view.map((x) => (x >= 0 ? -1 : 65536));
    const key = JSON.stringify([axis, steps.map((x) => Math.min(Math.max(x, -1), 65536)), this.cut]);
    if (key === this.key) return;
    this.key = key;
    const { axis: cut, low, high } = this.cut, halves = this.splats.halves;
    const kept = cut < 0 ? () => true : (n) => halves[8 * n + cut] >= low && halves[8 * n + cut] <= high;
    this.drawn = orderSplats(this.lattices[axis], halves, steps, kept, this.order);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, this.order.subarray(0, Math.max(this.drawn, count ? 1 : 0)));
  }

  // Draws the splats into the half-float target: linear, premultiplied, row 0 first.
  drawSplats(camera, size, antialias, extentOf) {
    const gl = this.gl, { scene } = this, kind = antialias ? "on" : "off";
    this.resize(size);
    const { block, eye } = frameBlock(camera, scene.grid, scene.frame, size, extentOf);
    this.sort(camera, eye);
    const program = (this.programs[kind] ??= this.compiled(this.shaders[kind]));
    gl.useProgram(program);
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.blocks[0]);
    gl.bufferData(gl.UNIFORM_BUFFER, block, gl.DYNAMIC_DRAW);
    this.blocks.forEach((buffer, binding) => gl.bindBufferBase(gl.UNIFORM_BUFFER, binding, buffer));
    // the first unit is that of samplers which no picture of a page reads, too
    const samplers = { footprint_table: this.footprint, class_table: this.classes, quantized_splats: this.splatTexture };
    Object.entries(samplers).forEach(([name, texture], n) => {
      gl.activeTexture(gl.TEXTURE0 + n);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(gl.getUniformLocation(program, name), n);
    });
    gl.activeTexture(gl.TEXTURE0 + 7);
    gl.uniform1f(gl.getUniformLocation(program, "position_step"), scene.step);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, ...size);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.blendEquation(scene.maximum ? gl.MAX : gl.FUNC_ADD);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    // words that splats of a page do not have
    for (const name of ["in_second", "in_rest"]) {
      const place = gl.getAttribLocation(program, name);
      if (place >= 0) gl.vertexAttribI4ui(place, 0, 0, 0, 0);
    }
    if (this.drawn) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.drawn);
  }

  // Draws the picture of a camera on the canvas over linear RGB.
  draw(camera, size, antialias, extentOf, background) {
    const gl = this.gl;
    this.drawSplats(camera, size, antialias, extentOf);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, ...size);
    gl.disable(gl.BLEND);
    gl.useProgram(this.screen);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    const at = (name) => gl.getUniformLocation(this.screen, name);
    gl.uniform1i(at("picture"), 0);
    gl.uniform2f(at("size"), ...size);
    gl.uniform1f(at("scale"), 1);
    gl.uniform4f(at("background"), ...background, 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // The linear premultiplied pixels of a camera, row 0 on top.
  pixels(camera, size, antialias, extentOf) {
    const values = new Float32Array(4 * size[0] * size[1]);
    this.drawSplats(camera, size, antialias, extentOf);
    this.gl.readPixels(0, 0, ...size, this.gl.RGBA, this.gl.FLOAT, values);
    return values;
  }
}

// ---- what lies over the picture

const SVG = "http://www.w3.org/2000/svg";

function element(name, attributes, text, kind = SVG) {
  const made = document.createElementNS(kind, name);
  Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
  if (text !== undefined) made.textContent = text;
  return made;
}

// The largest of 1, 2, 5 · 10ⁿ up to a length.
function niceBelow(length) {
  const power = 10 ** Math.floor(Math.log10(length) + 1e-9);
  return [5, 2, 1].find((step) => step * power <= length * (1 + 1e-9)) * power;
}

// A length in a unit with few digits.
function lengthText(length, unit) {
  const metres = { nm: 1e-9, um: 1e-6, mm: 1e-3, m: 1, km: 1e3 }, sign = (name) => (name === "um" ? "µm" : name);
  if (!(unit in metres) || (length >= 1 - 1e-9 && length < 1000)) return `${+length.toPrecision(6)} ${sign(unit)}`.trim();
  const names = Object.keys(metres), long = length * metres[unit];
  const name = names.filter((each) => long >= metres[each] * (1 - 1e-9)).pop() ?? "nm";
  return `${+(long / metres[name]).toPrecision(6)} ${sign(name)}`;
}

// Draws the scale bar, the axes and the colour bars of a view into an SVG of width × height CSS pixels.
function overlay(svg, scene, camera, target, size, extent, tables, ink) {
  const [width, height] = size, parts = [], em = Math.min(Math.max(width / 36, 10), 14);
  const text = (x, y, words, anchor = "middle") => parts.push(element("text", { x, y, "text-anchor": anchor }, words));
  const line = (x1, y1, x2, y2, more = {}) => parts.push(element("line", { x1, y1, x2, y2, stroke: "currentColor", ...more }));
  const depth = dot(camera.axes[2], add(target, camera.eye, -1));
  const pitch = (extent / height) * (camera.perspective ? depth : 1);
  if (pitch > 0) {
    const length = niceBelow(0.25 * width * pitch), right = width - em;
    line(right - length / pitch, height - em, right, height - em, { "stroke-width": 3 });
    text(right - length / pitch / 2, height - 1.6 * em, lengthText(length, scene.unit));
  }
  const middle = [3.6 * em, height - 3.6 * em], columns = transposed(camera.axes);
  [0, 1, 2].sort((a, b) => columns[b][2] - columns[a][2]).forEach((axis) => {
    const [x, y] = columns[axis].map((part) => part * 2 * em);
    line(...middle, middle[0] + x, middle[1] + y, { stroke: ["#d9483b", "#4d9a3a", "#3d7de0"][axis], "stroke-width": 2 });
    text(middle[0] + 1.35 * x, middle[1] + 1.35 * y + 0.35 * em, scene.letters[axis]);
  });
  let left = width - 1.8 * em;
  scene.bars.forEach((bar, number) => {
    const table = tables[bar.layer], rows = 64, tall = 0.42 * height, top = (height - tall) / 2 - em;
    const stops = Array.from({ length: rows }, (_, n) => {
      const value = bar.high - ((n + 0.5) / rows) * (bar.high - bar.low);
      const at = Math.round(((value - bar.first) / (bar.last - bar.first)) * (table.length / 4 - 1));
      const entry = 4 * Math.min(Math.max(at, 0), table.length / 4 - 1);
      return cssColor(table.slice(entry, entry + 3));
    });
    stops.forEach((fill, n) =>
      parts.push(element("rect", { x: left, y: top + (n * tall) / rows, width: em, height: tall / rows + 0.6, fill, "shape-rendering": "crispEdges" })));
    parts.push(element("rect", { x: left, y: top, width: em, height: tall, fill: "none", stroke: "currentColor" }));
    bar.ticks.forEach((value) => {
      const y = top + ((bar.high - value) / (bar.high - bar.low)) * tall;
      line(left - 4, y, left, y);
      text(left - 6, y + 0.35 * em, String(value), "end");
    });
    text(left + em, top - (0.6 + 1.2 * number) * em, bar.title, "end");
    left -= 5 * em;
  });
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  Object.assign(svg.style, { color: ink, fontSize: `${em}px` });
  svg.style.setProperty("--halo", ink === "#fff" ? "#000" : "#fff");
  svg.replaceChildren(...parts);
}

// ---- the view

const SLOW = 70, QUIET = 250, MOST_PIXELS = 4e6;

class View {
  constructor(page, scene) {
    Object.assign(this, { page, scene, painter: null, coarse: 1, touched: -Infinity, antialias: true });
    this.stage = page.querySelector("#stage");
    this.canvas = page.querySelector("canvas");
    this.svg = page.querySelector("svg");
    this.home = scene.camera;
    this.reset();
    new ResizeObserver(() => this.redraw()).observe(this.stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    this.listen();
    this.redraw();
  }

  // The painter draws from here on, instead of the first picture.
  begin(painter) {
    this.painter = painter;
    this.redraw();
  }

  reset() {
    this.camera = { ...this.home, axes: this.home.axes.map((row) => [...row]) };
    this.target = this.scene.target;
  }

  get isHome() {
    return this.camera.extent === this.home.extent && String(this.camera.eye) === String(this.home.eye) &&
      String(this.camera.axes) === String(this.home.axes);
  }

  // Linear RGB below the picture: the scene's, else the page's.
  get background() {
    if (this.scene.background) return this.scene.background;
    return matchMedia("(prefers-color-scheme: dark)").matches ? [0, 0, 0] : [1, 1, 1];
  }

  // The vertical extent of a picture of a size in which the first picture fits.
  extentOf(camera, [width, height]) {
    const [w, h] = this.home.size;
    return camera.extent * Math.max(1, w / h / (width / height));
  }

  turn(right, down) {
    const distance = dot(this.camera.axes[2], add(this.target, this.camera.eye, -1));
    for (const [axis, angle] of [[[0, 1, 0], right], [[1, 0, 0], -down]])
      this.camera.axes = turned(this.camera.axes, axis, angle);
    this.camera.eye = add(this.target, this.camera.axes[2], -distance);
    this.change();
  }

  move(x, y) {
    const distance = this.camera.perspective ? dot(this.camera.axes[2], add(this.target, this.camera.eye, -1)) : 1;
    const scale = (this.extentOf(this.camera, this.cssSize) / this.cssSize[1]) * Math.abs(distance);
    const shift = add(this.camera.axes[0].map((k) => -k * x * scale), this.camera.axes[1], -y * scale);
    [this.camera.eye, this.target] = [this.camera.eye, this.target].map((point) => add(point, shift));
    this.change();
  }

  zoom(factor) {
    if (this.camera.perspective) this.camera.eye = add(this.target, add(this.camera.eye, this.target, -1), 1 / factor);
    else this.camera.extent /= factor;
    this.change();
  }

  change() {
    this.touched = performance.now();
    this.redraw();
  }

  get cssSize() {
    const box = this.stage.getBoundingClientRect();
    return [Math.max(box.width, 1), Math.max(box.height, 1)];
  }

  redraw() {
    this.frame ??= requestAnimationFrame((now) => this.paint(now));
  }

  paint() {
    this.frame = undefined;
    const [width, height] = this.cssSize, ratio = Math.min(devicePixelRatio, Math.sqrt(MOST_PIXELS / (width * height)));
    const moving = performance.now() - this.touched < QUIET, coarse = moving ? this.coarse : 1;
    const size = [width, height].map((side) => Math.max(1, Math.round((side * ratio) / coarse)));
    const background = this.background;
    if (this.painter) {
      if (this.canvas.width !== size[0] || this.canvas.height !== size[1])
        [this.canvas.width, this.canvas.height] = size;
      const started = performance.now();
      this.painter.draw(this.camera, size, this.antialias, this.extentOf.bind(this), background);
      // waits for the card
      this.painter.gl.readPixels(0, 0, 1, 1, this.painter.gl.RGBA, this.painter.gl.UNSIGNED_BYTE, new Uint8Array(4));
      this.seconds = (performance.now() - started) / 1000;
      if (moving && 1000 * this.seconds > SLOW) this.coarse = Math.min(2 * this.coarse, 4);
      this.stage.classList.add("live");
    }
    this.annotate();
    this.stage.style.background = cssColor(background);
    clearTimeout(this.rest);
    if (moving && coarse > 1) this.rest = setTimeout(() => this.redraw(), QUIET);
  }

  // Draws what lies over the picture; over the printed one that of the first view.
  annotate() {
    const luminance = dot(this.background, [0.21, 0.72, 0.07]), ink = luminance < 0.2 ? "#fff" : "#000";
    const tables = this.painter?.shown ?? this.scene.layers.map((x) => new Float32Array(bytesOf(x.table).buffer));
    const [camera, target] = this.printing ? [this.home, this.scene.target] : [this.camera, this.target];
    overlay(this.svg, this.scene, camera, target, this.cssSize, this.extentOf(camera, this.cssSize), tables, ink);
  }

  // ---- input

  listen() {
    const at = (name) => this.page.querySelector(`#${name}`), pointers = new Map();
    this.stage.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, event);
      this.stage.setPointerCapture(event.pointerId);
      this.stage.focus({ preventScroll: true });
    });
    for (const name of ["pointerup", "pointercancel"])
      this.stage.addEventListener(name, (event) => pointers.delete(event.pointerId));
    this.stage.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before || !this.painter) return;
      pointers.set(event.pointerId, event);
      const [x, y] = [event.clientX - before.clientX, event.clientY - before.clientY];
      const other = [...pointers.values()].find((each) => each.pointerId !== event.pointerId);
      if (other) {
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        this.move(x / 2, y / 2);
        if (apart(before) > 0) this.zoom(apart(event) / apart(before));
      } else if (event.shiftKey || event.buttons & 6) this.move(x, y);
      else this.turn((-x / this.cssSize[1]) * Math.PI, (-y / this.cssSize[1]) * Math.PI);
    });
    this.stage.addEventListener("contextmenu", (event) => event.preventDefault());
    this.stage.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (this.painter) this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
    }, { passive: false });
    this.stage.addEventListener("dblclick", () => this.press("r"));
    this.stage.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.painter) return;
      if (this.press(event.key)) event.preventDefault();
    });
    at("reset").addEventListener("click", () => this.press("r"));
    at("full").addEventListener("click", () => this.press("f"));
    at("antialias").addEventListener("change", (event) => {
      this.antialias = event.target.checked;
      this.change();
    });
    for (const name of ["opacity", "window"])
      at(name).addEventListener("input", () => {
        this.painter?.classify(2 ** +at("opacity").value, +at("window").value);
        this.change();
      });
    for (const name of ["side", "cut"])
      at(name).addEventListener("input", () => {
        this.cut(at("side").value, +at("cut").value);
        at("cut").disabled = at("side").value === "";
      });
    for (const [name, printing] of [["beforeprint", true], ["afterprint", false]])
      addEventListener(name, () => {
        this.printing = printing;
        this.annotate();
      });
  }

  // Applies a key; false for others.
  press(key) {
    const step = Math.PI / 24, turns = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (key in turns) this.turn(...turns[key]);
    else if (key === "+" || key === "=") this.zoom(1.15);
    else if (key === "-") this.zoom(1 / 1.15);
    else if (key === "r" || key === "Home") {
      this.reset();
      this.change();
    } else if (key === "a") {
      const box = this.page.querySelector("#antialias");
      this.antialias = box.checked = !this.antialias;
      this.change();
    } else if (key === "f") {
      if (document.fullscreenElement) document.exitFullscreen();
      else this.stage.requestFullscreen?.();
    } else return false;
    return true;
  }

  // Cuts a share of the grid away from a side: "0-" is the low end of x, "" cuts nothing.
  cut(side, share) {
    if (!this.painter) return;
    const axis = side === "" ? -1 : +side[0], most = axis < 0 ? 0 : this.scene.grid.last[axis] / this.scene.step;
    const low = side[1] === "-" ? share * most : 0, high = side[1] === "+" ? (1 - share) * most : 65535;
    this.painter.cut = { axis, low, high };
    this.change();
  }
}

async function start() {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const scene = read("scene"), view = new View(document, scene);
  try {
    const planes = await inflated(bytesOf(document.getElementById("splats").textContent.trim()));
    view.begin(new Painter(view.canvas, scene, read("shaders"), unpackSplats(planes, scene.count, scene.row)));
  } catch (error) {
    document.getElementById("state").textContent = `This picture stands still: ${error.message}.`;
    document.getElementById("controls").hidden = true;
  }
  return view;
}

View.frameBlock = frameBlock;
globalThis.splatgl = start();
