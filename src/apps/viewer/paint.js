// What is shown, and the two ways to draw it. Everything drawn follows from `state`.
const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);
const { rows, columns, width, height } = data;
// The disparities of the set shown.
let { low, high } = data.sets[0];
const centre = { u: Math.floor(columns / 2), v: Math.floor(rows / 2) };
const reach = Math.max(1, centre.u, centre.v);
const state = { focus: data.sets[0].start, target: data.sets[0].start, u: 0, v: 0, aperture: 1, set: 0, scale: 1 };
const options = new Set(location.hash.slice(1).split(","));

const bitmap = (text, type) => {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return createImageBitmap(new Blob([bytes], { type }));
};
const bitmaps = data.sets.map(() => null);
const load = (k) => (bitmaps[k] ??= Promise.all(data.sets[k].views.map((text) => bitmap(text, "image/jpeg"))));

// Weight of the view (u, v) from the present viewpoint: a soft disc, never smaller than what joins neighbours.
const radius = () => Math.max(0.5, state.aperture * reach);
const weight = (u, v) => Math.max(0, Math.min(1, radius() + 0.5 - Math.hypot(u - state.u, v - state.v)));
// The views with a weight, with their offsets from the middle and weights, column by column.
function seen() {
  const list = [];
  for (let u = 0; u < columns; u++) {
    for (let v = 0; v < rows; v++) {
      const du = u - centre.u, dv = v - centre.v, w = weight(du, dv);
      if (w > 0) list.push({ at: v * columns + u, du, dv, w });
    }
  }
  return list;
}

// On a graphics processor. Where WebGL2 would be drawn in software the plain canvas is much faster; `#webgl` forces WebGL2.
function webgl(canvas) {
  if (options.has("plain")) return null;
  const wish = { alpha: false, antialias: false, preserveDrawingBuffer: true, failIfMajorPerformanceCaveat: !options.has("webgl") };
  const gl = canvas.getContext("webgl2", wish);
  if (!gl) return null;
  const named = gl.getExtension("WEBGL_debug_renderer_info");
  const renderer = named ? gl.getParameter(named.UNMASKED_RENDERER_WEBGL) : "";
  if (/swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer) && !options.has("webgl")) return null;
  const layers = rows * columns;
  const small = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) < layers || gl.getParameter(gl.MAX_TEXTURE_SIZE) < Math.max(width, height);
  if (small) return null;
  const shader = (type, text) => {
    const s = gl.createShader(type);
    gl.shaderSource(s, text);
    gl.compileShader(s);
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
  // The views are stored with the screen's curve and decoded by the texture unit: the sum is in linear light.
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
  const at = (name) => gl.getUniformLocation(program, name);
  const places = { shift: at("shift"), viewpoint: at("viewpoint"), centre: at("centre"), radius: at("radius") };
  const textures = data.sets.map(() => null);
  return {
    name: "WebGL2",
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
      if (canvas.width !== w || canvas.height !== h) {
        canvas.width = w;
        canvas.height = h;
      }
      gl.viewport(0, 0, w, h);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, textures[k]);
      gl.uniform2f(places.shift, state.focus / width, state.focus / height);
      gl.uniform2f(places.viewpoint, state.u, state.v);
      gl.uniform2f(places.centre, centre.u, centre.v);
      gl.uniform1f(places.radius, radius());
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    },
    async finish(k) { this.draw(k); },
    pixels() {
      const out = new Uint8Array(canvas.width * canvas.height * 4);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, out);
      return { data: out, width: canvas.width, height: canvas.height, flipped: true };
    },
  };
}

const DECODE = Float32Array.from({ length: 256 }, (_, k) => (k <= 10 ? k / 255 / 12.92 : ((k / 255 + 0.055) / 1.055) ** 2.4));
// Screen values of linear light, by its square root in 4096 steps.
const ENCODE = Uint8ClampedArray.from({ length: 4097 }, (_, k) => {
  const light = (k / 4096) ** 2;
  return 255 * (light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055);
});

// Without a graphics processor: while something moves, views are drawn over one another at whole pixels, each with its share
// of what is there so far, at half size where the machine is slow; once it rests, the sum is made anew in linear light with
// sub-pixel shifts.
function plain(canvas) {
  canvas.width = width;
  canvas.height = height;
  const page = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
  const surface = (w, h) => new OffscreenCanvas(w, h).getContext("2d", { alpha: false, willReadFrequently: true });
  const half = { w: Math.max(1, width >> 1), h: Math.max(1, height >> 1) };
  const sizes = [
    { by: 1, w: width, h: height, sum: surface(width, height), part: surface(width, height), sets: data.sets.map(() => null) },
    { by: 0.5, ...half, sum: surface(half.w, half.h), part: surface(half.w, half.h), sets: data.sets.map(() => null) },
  ];
  let turn = 0;
  return {
    name: "canvas",
    fill(k, images) {
      sizes[0].sets[k] = images;
      const less = { resizeWidth: half.w, resizeHeight: half.h, resizeQuality: "medium" };
      Promise.all(images.map((image) => createImageBitmap(image, less))).then((small) => { sizes[1].sets[k] = small; });
    },
    draw(k) {
      turn++;
      const { by, w, h, sum, part, sets } = state.scale < 1 && sizes[1].sets[k] ? sizes[1] : sizes[0];
      const step = state.focus * by;
      // Column by column, so that no share gets too small for eight bits.
      let all = 0, column = 0, last = null;
      const add = () => {
        if (column <= 0) return;
        all += column;
        sum.globalAlpha = column / all;
        sum.drawImage(part.canvas, 0, 0);
      };
      for (const { at, du, dv, w: own } of seen()) {
        if (du !== last) {
          add();
          column = 0;
          last = du;
        }
        column += own;
        part.globalAlpha = own / column;
        part.drawImage(sets[k][at], -Math.round(step * du), -Math.round(step * dv));
      }
      add();
      page.imageSmoothingEnabled = true;
      page.drawImage(sum.canvas, 0, 0, w, h, 0, 0, width, height);
    },
    // Resolves to whether it came to an end: a later picture takes precedence.
    async finish(k) {
      const mine = ++turn, images = sizes[0].sets[k], { sum } = sizes[0];
      const light = new Float32Array(3 * width * height), share = new Float32Array(width * height);
      for (const { at, du, dv, w } of seen()) {
        await new Promise((done) => setTimeout(done));
        if (turn !== mine) return false;
        sum.globalAlpha = 1;
        sum.drawImage(images[at], 0, 0);
        addShifted(light, share, sum.getImageData(0, 0, width, height).data, state.focus * du, state.focus * dv, w);
      }
      const out = page.createImageData(width, height);
      for (let i = 0; i < share.length; i++) {
        const scale = share[i] > 0 ? 1 / share[i] : 0;
        for (let c = 0; c < 3; c++) out.data[4 * i + c] = ENCODE[Math.round(4096 * Math.sqrt(Math.min(1, light[3 * i + c] * scale)))];
        out.data[4 * i + 3] = 255;
      }
      page.putImageData(out, 0, 0);
      return true;
    },
    pixels() {
      const image = page.getImageData(0, 0, width, height);
      return { data: image.data, width, height, flipped: false };
    },
  };
}

// Adds `w` times a view, moved by (dx, dy) with bilinear weights, where it reaches.
function addShifted(light, share, bytes, dx, dy, w) {
  const ix = Math.floor(dx), iy = Math.floor(dy), fx = dx - ix, fy = dy - iy;
  const [a, b, c, d] = [(1 - fx) * (1 - fy) * w, fx * (1 - fy) * w, (1 - fx) * fy * w, fx * fy * w];
  const right = fx > 0 ? 4 : 0, below = fy > 0 ? 4 * width : 0;
  const s0 = Math.max(0, -ix), s1 = Math.min(width, width - ix - (fx > 0 ? 1 : 0));
  const t0 = Math.max(0, -iy), t1 = Math.min(height, height - iy - (fy > 0 ? 1 : 0));
  for (let t = t0; t < t1; t++) {
    let from = 4 * ((t + iy) * width + s0 + ix), to = t * width + s0;
    for (let s = s0; s < s1; s++, from += 4, to++) {
      for (let k = 0; k < 3; k++) {
        const p = from + k;
        light[3 * to + k] += a * DECODE[bytes[p]] + b * DECODE[bytes[p + right]] + c * DECODE[bytes[p + below]] + d * DECODE[bytes[p + right + below]];
      }
      share[to] += w;
    }
  }
}

// A canvas has one kind of context for good: the second painter gets a new canvas.
function choosePainter(problems) {
  try {
    const painter = webgl($("view"));
    if (painter) return painter;
  } catch (error) {
    problems.push(String(error));
  }
  const fresh = $("view").cloneNode(false);
  $("view").replaceWith(fresh);
  return plain(fresh);
}
