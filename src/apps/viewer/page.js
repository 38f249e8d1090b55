'use strict';
// State of the viewer: everything drawn follows from it.
const problems = [];
addEventListener('error', e => problems.push(String(e.message)));
addEventListener('unhandledrejection', e => problems.push(String(e.reason)));
const $ = id => document.getElementById(id);
const data = JSON.parse($('data').textContent);
const { rows, columns, width, height, low, high } = data;
const centre = { u: Math.floor(columns / 2), v: Math.floor(rows / 2) };
const reach = Math.max(1, centre.u, centre.v);
const state = { focus: data.start, target: data.start, u: 0, v: 0, aperture: 1, set: 0, scale: 1 };
const options = new Set(location.hash.slice(1).split(','));
const canvas = $('view'), stage = $('stage');
canvas.width = width; canvas.height = height;
$('depth').width = width; $('depth').height = height;

const blob = (text, type) => {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return createImageBitmap(new Blob([bytes], { type }));
};
const bitmaps = data.sets.map(() => null);
const load = k => bitmaps[k] ??= Promise.all(data.sets[k].views.map(t => blob(t, 'image/jpeg')));

// How much the view (u, v) counts from the present viewpoint: a soft disc, never smaller than what joins neighbours.
const radius = () => Math.max(0.5, state.aperture * reach);
const weight = (u, v) => Math.max(0, Math.min(1, radius() + 0.5 - Math.hypot(u - state.u, v - state.v)));

function webgl() {
  if (options.has('plain')) return null;
  const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, preserveDrawingBuffer: true });
  if (!gl) return null;
  const layers = rows * columns;
  if (gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) < layers || gl.getParameter(gl.MAX_TEXTURE_SIZE) < Math.max(width, height)) return null;
  const shader = (type, text) => {
    const s = gl.createShader(type);
    gl.shaderSource(s, text); gl.compileShader(s);
    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
    return s;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `#version 300 es
    out vec2 place;
    void main() {
      vec2 p = vec2(float(gl_VertexID & 1) * 4.0 - 1.0, float(gl_VertexID >> 1) * 4.0 - 1.0);
      place = vec2(p.x * 0.5 + 0.5, 0.5 - p.y * 0.5);
      gl_Position = vec4(p, 0.0, 1.0);
    }`));
  // The views are stored with the screen's curve and decoded by the texture unit: the sum is one of light.
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `#version 300 es
    precision highp float;
    precision highp sampler2DArray;
    uniform sampler2DArray views;
    uniform vec2 shift, viewpoint, centre;
    uniform float radius;
    in vec2 place;
    out vec4 colour;
    void main() {
      vec4 sum = vec4(0.0);
      for (int v = 0; v < ${rows}; v++) for (int u = 0; u < ${columns}; u++) {
        vec2 at = vec2(float(u), float(v)) - centre;
        float w = clamp(radius + 0.5 - length(at - viewpoint), 0.0, 1.0);
        if (w > 0.0) sum += w * vec4(textureLod(views, vec3(place + shift * at, float(v * ${columns} + u)), 0.0).rgb, 1.0);
      }
      vec3 light = sum.rgb / max(sum.a, 1e-6);
      vec3 screen = mix(12.92 * light, 1.055 * pow(max(light, vec3(0.0)), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light));
      colour = vec4(screen, 1.0);
    }`));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const at = name => gl.getUniformLocation(program, name);
  const places = { shift: at('shift'), viewpoint: at('viewpoint'), centre: at('centre'), radius: at('radius') };
  const textures = data.sets.map(() => null);
  return {
    name: 'WebGL2',
    fill(k, images) {
      if (textures[k]) return;
      textures[k] = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, textures[k]);
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.SRGB8_ALPHA8, width, height, layers);
      images.forEach((image, i) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, i, width, height, 1, gl.RGBA, gl.UNSIGNED_BYTE, image));
      for (const p of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, p, gl.LINEAR);
      for (const p of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, p, gl.CLAMP_TO_EDGE);
    },
    draw(k) {
      const w = Math.round(width * state.scale), h = Math.round(height * state.scale);
      if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
      gl.viewport(0, 0, w, h);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, textures[k]);
      gl.uniform2f(places.shift, state.focus / width, state.focus / height);
      gl.uniform2f(places.viewpoint, state.u, state.v);
      gl.uniform2f(places.centre, centre.u, centre.v);
      gl.uniform1f(places.radius, radius());
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    },
    pixels() {
      const out = new Uint8Array(canvas.width * canvas.height * 4);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, out);
      return { data: out, width: canvas.width, height: canvas.height, flipped: true };
    },
  };
}

// Without WebGL2: views drawn over one another, each with its share of what is there so far.
function plain(surface) {
  const c = surface.getContext('2d', { willReadFrequently: true });
  return {
    name: 'canvas',
    images: null,
    fill(k, images) { this.images = images; },
    draw() {
      const s = 1;
      let sum = 0;
      for (let v = 0; v < rows; v++) for (let u = 0; u < columns; u++) {
        const w = weight(u - centre.u, v - centre.v);
        if (w <= 0) continue;
        sum += w;
        c.globalAlpha = w / sum;
        c.drawImage(this.images[v * columns + u], -state.focus * (u - centre.u) * s, -state.focus * (v - centre.v) * s);
      }
      c.globalAlpha = 1;
    },
    pixels() {
      const image = c.getImageData(0, 0, surface.width, surface.height);
      return { data: image.data, width: surface.width, height: surface.height, flipped: false };
    },
  };
}

let painter = null;
try { painter = webgl(); } catch (e) { problems.push(String(e)); }
painter ??= plain(canvas);

// Drawing: at full size when still, smaller while moving if the machine is slow.
let ready = false, queued = false, last = 0, slow = 1;
function show() {
  if (!ready) return;
  painter.draw(state.set);
  $('focus').value = Math.round(1000 * (state.target - low) / (high - low));
  $('focus-value').value = state.target.toFixed(2);
  $('aperture').value = Math.round(100 * state.aperture);
  $('aperture-value').value = Math.round(100 * state.aperture) + ' %';
}
let settle = 0;
function change() {
  if (queued || !ready) return;
  queued = true;
  requestAnimationFrame(now => {
    queued = false;
    const step = now - last;
    if (step < 400 && painter.name === 'WebGL2') {
      if (step > 40) slow = Math.max(0.35, slow * 0.8);
      else if (step < 22) slow = Math.min(1, slow * 1.1);
    }
    last = now;
    const gap = state.target - state.focus;
    state.focus = Math.abs(gap) < 0.004 ? state.target : state.focus + 0.3 * gap;
    const moving = state.focus !== state.target;
    state.scale = slow;
    show();
    clearTimeout(settle);
    if (moving) change();
    else settle = setTimeout(() => { state.scale = 1; last = 0; show(); }, 150);
  });
}

// Depth of the middle view, for focusing where one points.
let depth = null;
async function readDepth() {
  const image = await blob(data.depth, 'image/png');
  const c = new OffscreenCanvas(width, height).getContext('2d');
  c.drawImage(image, 0, 0, width, height);
  depth = c.getImageData(0, 0, width, height).data;
  const o = $('depth').getContext('2d'), over = o.createImageData(width, height);
  const stops = [[48, 18, 92], [59, 82, 139], [33, 145, 140], [94, 201, 98], [190, 223, 38], [253, 245, 160]];
  for (let i = 0; i < depth.length; i += 4) {
    const x = 5 * (data.front < 0 ? 255 - depth[i] : depth[i]) / 255, k = Math.min(4, Math.floor(x)), f = x - k;
    for (let c = 0; c < 3; c++) over.data[i + c] = stops[k][c] * (1 - f) + stops[k + 1][c] * f;
    over.data[i + 3] = 255;
  }
  o.putImageData(over, 0, 0);
}
const disparityAt = (x, y) => {
  const px = Math.max(0, Math.min(width - 1, Math.floor(x))), py = Math.max(0, Math.min(height - 1, Math.floor(y)));
  return low + (high - low) * depth[4 * (py * width + px)] / 255;
};

async function choose(k) {
  state.set = k;
  const images = await load(k);
  if (state.set !== k) return;
  painter.fill(k, images);
  [...$('methods').children].forEach((b, i) => b.setAttribute('aria-pressed', String(i === k)));
  ready = true;
  change();
}

// Hands: pointer, wheel, keys.
const place = e => {
  const r = canvas.getBoundingClientRect();
  return { x: (e.clientX - r.left) / r.width * width, y: (e.clientY - r.top) / r.height * height };
};
function focusAt(x, y) {
  if (!depth) return;
  state.target = disparityAt(x, y);
  const mark = $('mark');
  mark.style.left = 100 * x / width + '%'; mark.style.top = 100 * y / height + '%';
  mark.style.opacity = 1; setTimeout(() => { mark.style.opacity = 0; }, 400);
  change();
}
function move(u, v) {
  const limit = Math.max(1, reach);
  const r = Math.hypot(u, v), f = r > limit ? limit / r : 1;
  state.u = u * f; state.v = v * f;
  change();
}
function open(a) { state.aperture = Math.max(0, Math.min(1, a)); change(); }
const fingers = new Map();
let drag = null, pinch = 0;
stage.addEventListener('pointerdown', e => {
  fingers.set(e.pointerId, e);
  try { stage.setPointerCapture(e.pointerId); } catch { /* a pointer made by a script cannot be captured */ }
  drag = { x: e.clientX, y: e.clientY, u: state.u, v: state.v, moved: false };
});
stage.addEventListener('pointermove', e => {
  if (!$('epi').hidden) strip(place(e).y);
  if (!fingers.has(e.pointerId)) return;
  fingers.set(e.pointerId, e);
  if (fingers.size > 1) {
    const [a, b] = [...fingers.values()], d = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    if (pinch) open(state.aperture * d / pinch);
    pinch = d; drag = null;
    return;
  }
  if (!drag) return;
  const size = canvas.getBoundingClientRect().width;
  const dx = e.clientX - drag.x, dy = e.clientY - drag.y;
  if (Math.hypot(dx, dy) > 4) drag.moved = true;
  if (drag.moved) move(drag.u + 4 * reach * dx / size, drag.v + 4 * reach * dy / size);
});
const lift = e => {
  const had = fingers.delete(e.pointerId);
  if (fingers.size < 2) pinch = 0;
  if (had && e.type === 'pointerup' && drag && !drag.moved) { const p = place(e); focusAt(p.x, p.y); }
  if (fingers.size === 0) drag = null;
};
stage.addEventListener('pointerup', lift);
stage.addEventListener('pointercancel', lift);
stage.addEventListener('wheel', e => { e.preventDefault(); open(state.aperture - Math.sign(e.deltaY) * 0.05); }, { passive: false });
$('focus').addEventListener('input', e => { state.target = low + (high - low) * e.target.value / 1000; change(); });
$('aperture').addEventListener('input', e => open(e.target.value / 100));
const toggle = (button, element) => {
  element.hidden = !element.hidden;
  button.setAttribute('aria-pressed', String(!element.hidden));
};
$('show-depth').addEventListener('click', () => toggle($('show-depth'), $('depth')));
$('show-epi').addEventListener('click', () => { toggle($('show-epi'), $('epi')); strip(height / 2); });
const reset = () => { Object.assign(state, { target: data.start, u: 0, v: 0, aperture: 1 }); change(); };
$('reset').addEventListener('click', reset);
addEventListener('keydown', e => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.target.tagName === 'INPUT') return;
  const step = (high - low) / 50;
  const act = {
    ArrowLeft: () => move(state.u - 0.3, state.v), ArrowRight: () => move(state.u + 0.3, state.v),
    ArrowUp: () => move(state.u, state.v - 0.3), ArrowDown: () => move(state.u, state.v + 0.3),
    '[': () => { state.target = Math.max(low, state.target - step); change(); },
    ']': () => { state.target = Math.min(high, state.target + step); change(); },
    '+': () => open(state.aperture + 0.1), '=': () => open(state.aperture + 0.1), '-': () => open(state.aperture - 0.1),
    m: () => choose((state.set + 1) % data.sets.length), d: () => $('show-depth').click(), e: () => $('show-epi').click(), 0: reset,
  }[e.key.length === 1 ? e.key.toLowerCase() : e.key];
  if (act) { e.preventDefault(); act(); }
});
if (data.sets.length > 1) data.sets.forEach((set, k) => {
  const b = document.createElement('button');
  b.textContent = set.name;
  b.addEventListener('click', () => choose(k));
  $('methods').append(b);
});

// The epipolar image of a row: the same line of all views of the middle row, one below the other.
async function strip(y) {
  if ($('epi').hidden) return;
  const images = await load(state.set), c = $('epi'), t = Math.max(0, Math.min(height - 1, Math.floor(y)));
  c.width = width; c.height = columns;
  const g = c.getContext('2d');
  for (let u = 0; u < columns; u++) g.drawImage(images[centre.v * columns + u], 0, t, width, 1, 0, u, width, 1);
}

// Tells a script what works: page.html#selftest writes its findings into the document.
async function selftest(opened) {
  const pause = ms => new Promise(r => setTimeout(r, ms));
  const still = async () => { await pause(0); state.focus = state.target; state.scale = 1; show(); return painter.pixels(); };
  const differ = (a, b) => { let n = 0; for (let i = 0; i < a.data.length; i++) n += Math.abs(a.data[i] - b.data[i]); return n / a.data.length; };
  const sharp = (p, x, y, r) => {
    let n = 0;
    for (let j = Math.max(0, y - r); j < Math.min(p.height - 1, y + r); j++) for (let i = Math.max(0, x - r); i < Math.min(p.width - 1, x + r); i++) {
      const k = 4 * ((p.flipped ? p.height - 1 - j : j) * p.width + i) + 1;
      n += (p.data[k] - p.data[k + 4]) ** 2;
    }
    return n;
  };
  const found = { painter: painter.name, opened_ms: Math.round(opened), sets: data.sets.length };
  reset();
  const first = await still();
  state.target = high; const far = await still();
  found.refocus_changes = differ(first, far);
  // Clicks where there is most to see on one surface, through real events.
  const flat = (x, y) => {
    let lo = 255, hi = 0;
    for (let j = y - 16; j <= y + 16; j++) for (let i = x - 16; i <= x + 16; i++) { const d = depth[4 * (j * width + i)]; lo = Math.min(lo, d); hi = Math.max(hi, d); }
    return hi - lo < 16;
  };
  const points = [];
  state.target = data.start; state.aperture = 0; const single = await still(); state.aperture = 1;
  for (let y = 40; y < height - 40; y += 20) for (let x = 40; x < width - 40; x += 20) if (flat(x, y)) points.push([sharp(single, x, y, 12), x, y]);
  points.sort((a, b) => b[0] - a[0]);
  found.clicks = [];
  for (const [, x, y] of points.slice(0, 3)) {
    const r = canvas.getBoundingClientRect();
    const at = { clientX: r.left + (x + 0.5) / width * r.width, clientY: r.top + (y + 0.5) / height * r.height, pointerId: 7, bubbles: true };
    stage.dispatchEvent(new PointerEvent('pointerdown', at));
    stage.dispatchEvent(new PointerEvent('pointerup', at));
    const d = state.target, here = sharp(await still(), x, y, 12);
    let best = d, most = here;
    for (let k = 0; k <= 12; k++) {
      state.target = low + (high - low) * k / 12;
      const s = sharp(await still(), x, y, 12);
      if (s > most) { most = s; best = state.target; }
    }
    found.clicks.push({ x, y, disparity: d, sharpest: best, share: here / most });
  }
  reset(); const before = await still();
  const r = canvas.getBoundingClientRect(), from = { clientX: r.left + r.width / 2, clientY: r.top + r.height / 2, pointerId: 9, bubbles: true };
  state.aperture = 0.2; const narrow = await still();
  found.aperture_changes = differ(before, narrow);
  stage.dispatchEvent(new PointerEvent('pointerdown', from));
  stage.dispatchEvent(new PointerEvent('pointermove', { ...from, clientX: from.clientX + r.width * 0.2 }));
  stage.dispatchEvent(new PointerEvent('pointerup', { ...from, clientX: from.clientX + r.width * 0.2 }));
  found.drag_moves = state.u;
  found.drag_changes = differ(narrow, await still());
  // Frames: full aperture, full size, every frame different.
  reset();
  let frames = 0; const start = performance.now();
  while (performance.now() - start < 1500 && frames < 60) { state.target = state.focus = low + (high - low) * (frames % 30) / 30; state.scale = 1; show(); painter.pixels(); frames++; await pause(0); }
  found.frames_per_second = frames / ((performance.now() - start) / 1000);
  // The fallback, on a canvas of its own.
  const spare = new OffscreenCanvas(width, height), other = plain(spare);
  other.fill(0, await load(state.set));
  reset(); state.focus = state.target; other.draw(); const a = other.pixels();
  state.focus = high; other.draw();
  found.fallback_changes = differ(a, other.pixels());
  if (data.sets.length > 1) { reset(); const one = await still(); await choose(1); found.method_changes = differ(one, await still()); await choose(0); }
  reset(); await still();
  found.problems = problems;
  const pre = document.createElement('pre');
  pre.id = 'selftest'; pre.textContent = JSON.stringify(found);
  document.body.append(pre);
}

(async () => {
  const depthReady = readDepth();
  await choose(0);
  painter.draw(0);
  await depthReady;
  const opened = performance.now();
  $('status').textContent = `${rows}×${columns} views of ${width}×${height}, ${painter.name}.`;
  for (const part of options) {
    const [key, value] = part.split('=');
    if (key === 'focus' && isFinite(+value)) { state.target = +value; change(); }
    if (key === 'aperture' && isFinite(+value)) open(+value);
    if (key === 'depth') $('show-depth').click();
    if (key === 'epi') $('show-epi').click();
  }
  if (options.has('selftest')) await selftest(opened);
})().catch(e => { problems.push(String(e)); $('status').textContent = 'This light field cannot be shown: ' + e; });
