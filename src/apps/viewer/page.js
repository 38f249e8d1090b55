// Pointer and keyboard input, and the order of drawing.
const problems = [];
addEventListener("error", (e) => problems.push(String(e.message)));
addEventListener("unhandledrejection", (e) => problems.push(String(e.reason)));
const stage = $("stage");
$("depth").width = width;
$("depth").height = height;
let painter = choosePainter(problems);
// Pictures drawn so far, and whether the picture shown is at rest and at full quality.
const painted = { frames: 0, still: false };

let ready = false, queued = false, last = 0, settle = 0;
function show() {
  if (!ready) return;
  painter.draw(state.set);
  painted.frames++;
  $("focus").value = Math.round((1000 * (state.target - low)) / (high - low));
  $("focus-value").value = state.target.toFixed(2);
  $("aperture").value = Math.round(100 * state.aperture);
  $("aperture-value").value = Math.round(100 * state.aperture) + " %";
}
// The picture at rest; another change cancels it.
async function rest() {
  last = 0;
  const scale = state.scale;
  state.scale = 1;
  const done = await painter.finish(state.set);
  state.scale = scale;
  if (done !== false) painted.still = true;
}
function change() {
  if (queued || !ready) return;
  queued = true;
  painted.still = false;
  requestAnimationFrame((now) => {
    queued = false;
    // While things move, the size follows the speed of the machine.
    const step = now - last;
    if (step < 400) {
      if (step > 34) state.scale = Math.max(0.35, state.scale * 0.8);
      else if (step < 20) state.scale = Math.min(1, state.scale * 1.05);
    }
    last = now;
    const gap = state.target - state.focus;
    state.focus = Math.abs(gap) < 0.004 ? state.target : state.focus + 0.3 * gap;
    show();
    clearTimeout(settle);
    if (state.focus !== state.target) change();
    else settle = setTimeout(rest, 150);
  });
}
// A graphics processor that goes away is replaced.
$("view").addEventListener("webglcontextlost", async () => {
  options.add("plain");
  painter = choosePainter(problems);
  painter.fill(state.set, await load(state.set));
  change();
});

// Depth of the middle view, for focusing at the pointer.
let depth = null;
async function readDepth(k) {
  const set = data.sets[k], image = await bitmap(set.depth, "image/png");
  if (chosen !== k) return;
  ({ low, high } = set);
  const c = new OffscreenCanvas(width, height).getContext("2d");
  c.drawImage(image, 0, 0, width, height);
  depth = c.getImageData(0, 0, width, height).data;
  const o = $("depth").getContext("2d"), over = o.createImageData(width, height);
  const stops = [[48, 18, 92], [59, 82, 139], [33, 145, 140], [94, 201, 98], [190, 223, 38], [253, 245, 160]];
  for (let i = 0; i < depth.length; i += 4) {
    const x = (5 * (set.front < 0 ? 255 - depth[i] : depth[i])) / 255, k = Math.min(4, Math.floor(x)), f = x - k;
    for (let c = 0; c < 3; c++) over.data[i + c] = stops[k][c] * (1 - f) + stops[k + 1][c] * f;
    over.data[i + 3] = 255;
  }
  o.putImageData(over, 0, 0);
}
const pixel = (x, n) => Math.max(0, Math.min(n - 1, Math.floor(x)));
const disparityAt = (x, y) => low + ((high - low) * depth[4 * (pixel(y, height) * width + pixel(x, width))]) / 255;

// The set shown changes once its pictures are there; of several choices the last one is shown.
let chosen = 0;
async function choose(k) {
  chosen = k;
  const images = await load(k);
  if (chosen !== k) return;
  painter.fill(k, images);
  // A light field of another depth is focused anew, in its middle.
  if (state.set !== k && data.sets[k].depth !== data.sets[state.set].depth && ready) {
    const { low: from, high: to, start } = data.sets[k];
    if (state.target < from || state.target > to) state.target = start;
  }
  state.set = k;
  await readDepth(k);
  if (chosen !== k) return;
  [...$("methods").children].forEach((b, i) => b.setAttribute("aria-pressed", String(i === k)));
  ready = true;
  change();
}

const place = (event) => {
  const at = within(event, stage);
  return { x: at.x * width, y: at.y * height };
};
function focusAt(x, y) {
  if (!depth) return;
  state.target = disparityAt(x, y);
  const mark = $("mark");
  mark.style.left = (100 * x) / width + "%";
  mark.style.top = (100 * y) / height + "%";
  mark.style.opacity = 1;
  setTimeout(() => { mark.style.opacity = 0; }, 400);
  change();
}
function move(u, v) {
  const r = Math.hypot(u, v), f = r > reach ? reach / r : 1;
  state.u = u * f;
  state.v = v * f;
  change();
}
function open(a) {
  state.aperture = Math.max(0, Math.min(1, a));
  change();
}
const fingers = new Map();
let drag = null, pinch = 0;
stage.addEventListener("pointerdown", (e) => {
  fingers.set(e.pointerId, e);
  stage.setPointerCapture(e.pointerId);
  drag = { x: e.clientX, y: e.clientY, u: state.u, v: state.v, moved: false };
});
stage.addEventListener("pointermove", (e) => {
  if (!$("epi").hidden) strip(place(e).y);
  if (!fingers.has(e.pointerId)) return;
  fingers.set(e.pointerId, e);
  if (fingers.size > 1) {
    const [a, b] = [...fingers.values()], d = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    if (pinch) open((state.aperture * d) / pinch);
    pinch = d;
    drag = null;
    return;
  }
  if (!drag) return;
  const size = stage.getBoundingClientRect().width;
  const dx = e.clientX - drag.x, dy = e.clientY - drag.y;
  if (Math.hypot(dx, dy) > 4) drag.moved = true;
  if (drag.moved) move(drag.u + (4 * reach * dx) / size, drag.v + (4 * reach * dy) / size);
});
const lift = (e) => {
  const had = fingers.delete(e.pointerId);
  if (fingers.size < 2) pinch = 0;
  if (had && e.type === "pointerup" && drag && !drag.moved) {
    const p = place(e);
    focusAt(p.x, p.y);
  }
  if (fingers.size === 0) drag = null;
};
stage.addEventListener("pointerup", lift);
stage.addEventListener("pointercancel", lift);
stage.addEventListener("wheel", (e) => {
  e.preventDefault();
  open(state.aperture - Math.sign(e.deltaY) * 0.05);
}, { passive: false });
$("focus").addEventListener("input", (e) => {
  state.target = low + ((high - low) * e.target.value) / 1000;
  change();
});
$("aperture").addEventListener("input", (e) => open(e.target.value / 100));
const toggle = (button, element) => {
  element.hidden = !element.hidden;
  button.setAttribute("aria-pressed", String(!element.hidden));
};
$("show-depth").addEventListener("click", () => toggle($("show-depth"), $("depth")));
$("show-epi").addEventListener("click", () => {
  toggle($("show-epi"), $("epi"));
  strip(height / 2);
});
const reset = () => {
  Object.assign(state, { target: data.sets[state.set].start, u: 0, v: 0, aperture: 1 });
  change();
};
$("reset").addEventListener("click", reset);
addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.target.tagName === "INPUT") return;
  const step = (high - low) / 50;
  const focus = (by) => {
    state.target = Math.max(low, Math.min(high, state.target + by));
    change();
  };
  const act = {
    ArrowLeft: () => move(state.u - 0.3, state.v), ArrowRight: () => move(state.u + 0.3, state.v),
    ArrowUp: () => move(state.u, state.v - 0.3), ArrowDown: () => move(state.u, state.v + 0.3),
    "[": () => focus(-step), "]": () => focus(step),
    "+": () => open(state.aperture + 0.1), "=": () => open(state.aperture + 0.1), "-": () => open(state.aperture - 0.1),
    m: () => choose((chosen + 1) % data.sets.length), d: () => $("show-depth").click(), e: () => $("show-epi").click(), 0: reset,
  }[e.key.length === 1 ? e.key.toLowerCase() : e.key];
  if (act) {
    e.preventDefault();
    act();
  }
});
if (data.sets.length > 1) data.sets.forEach((set, k) => {
  const button = make("button", "", $("methods"));
  button.textContent = set.name;
  button.addEventListener("click", () => choose(k));
});

// The epipolar image of a row: the same line of all views of the middle row, one below the other.
async function strip(y) {
  if ($("epi").hidden) return;
  const images = await load(state.set), c = $("epi");
  c.width = width;
  c.height = columns;
  const g = c.getContext("2d");
  for (let u = 0; u < columns; u++) g.drawImage(images[centre.v * columns + u], 0, pixel(y, height), width, 1, 0, u, width, 1);
}

(async () => {
  await choose(0);
  show();
  // Milliseconds from the start of loading to the first picture.
  document.documentElement.dataset.opened = Math.round(performance.now());
  $("status").textContent = `${rows}×${columns} views of ${width}×${height}, ${painter.name}.`;
  for (const part of options) {
    const [key, value] = part.split("=");
    if (key === "focus" && isFinite(+value)) state.target = +value;
    if (key === "aperture" && isFinite(+value)) open(+value);
    if (key === "depth") $("show-depth").click();
    if (key === "epi") $("show-epi").click();
  }
  change();
  document.documentElement.dataset.ready = "yes";
})().catch((e) => {
  problems.push(String(e));
  $("status").textContent = "This light field cannot be shown: " + e;
});
