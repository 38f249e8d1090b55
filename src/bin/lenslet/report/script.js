for (const section of document.querySelectorAll(".compare")) {
  const figures = [...section.querySelectorAll(".stages figure")];
  if (figures.length < 2) continue;
  const images = figures.map((f) => f.querySelector("img"));
  const names = figures.map((f) => f.querySelector("figcaption").textContent);
  const frame = make("div", "frame", section);
  frame.tabIndex = 0;
  frame.setAttribute("role", "group");
  frame.setAttribute("aria-label", section.getAttribute("aria-label") + ": arrow keys move the crop");
  // Small crops are enlarged only up to a limit.
  section.style.setProperty("--wide", Math.max(440, Math.min(760, Number(images[0].getAttribute("width")))) + "px");
  const under = make("img", "under", frame), over = make("img", "over", frame);
  make("span", "line", frame);
  const spot = make("span", "spot", frame);
  const left = make("span", "name left", frame), right = make("span", "name right", frame);
  const controls = make("div", "controls", section);
  const choose = (label, start) => {
    const select = make("select", "", controls);
    select.setAttribute("aria-label", label);
    names.forEach((name, k) => {
      const option = make("option", "", select);
      option.value = k;
      option.textContent = name;
    });
    select.value = start;
    select.addEventListener("change", show);
    return select;
  };
  const first = choose("left picture", 0);
  const range = make("input", "", controls);
  range.type = "range";
  range.min = 0;
  range.max = 100;
  range.step = 0.5;
  range.value = 50;
  range.setAttribute("aria-label", "where the left picture ends and the right one begins");
  const second = choose("right picture", Math.max(1, names.length - 2));
  make("p", "hint", section).textContent =
    "Drag or use the slider to move the border; point at the picture, or focus it and use the arrow keys, to choose the crop below.";
  const loupe = make("div", "loupe", section);
  const SIDE = 48, ZOOM = 4;
  const crops = names.map((name) => {
    const figure = make("figure", "", loupe);
    const canvas = make("canvas", "", figure);
    canvas.width = canvas.height = SIDE * ZOOM;
    make("figcaption", "", figure).textContent = name;
    return canvas.getContext("2d");
  });
  const at = { x: Number(section.dataset.x) || 0.5, y: Number(section.dataset.y) || 0.5 };
  function show() {
    under.src = images[first.value].src;
    over.src = images[second.value].src;
    under.alt = names[first.value];
    over.alt = names[second.value];
    left.textContent = names[first.value];
    right.textContent = names[second.value];
    frame.style.setProperty("--cut", range.value + "%");
  }
  function magnify() {
    const w = images[0].naturalWidth, h = images[0].naturalHeight;
    if (!w) return;
    const x = Math.round(Math.min(Math.max(at.x * w - SIDE / 2, 0), Math.max(w - SIDE, 0)));
    const y = Math.round(Math.min(Math.max(at.y * h - SIDE / 2, 0), Math.max(h - SIDE, 0)));
    spot.style.left = (100 * x) / w + "%";
    spot.style.top = (100 * y) / h + "%";
    spot.style.width = (100 * SIDE) / w + "%";
    spot.style.height = (100 * SIDE) / h + "%";
    crops.forEach((context, k) => {
      context.imageSmoothingEnabled = false;
      context.clearRect(0, 0, SIDE * ZOOM, SIDE * ZOOM);
      context.drawImage(images[k], x, y, SIDE, SIDE, 0, 0, SIDE * ZOOM, SIDE * ZOOM);
    });
  }
  const place = (event) => within(event, frame);
  let dragging = false;
  frame.addEventListener("pointerdown", (event) => {
    dragging = true;
    frame.setPointerCapture(event.pointerId);
    range.value = 100 * place(event).x;
    Object.assign(at, place(event));
    show();
    magnify();
  });
  frame.addEventListener("pointermove", (event) => {
    const p = place(event);
    if (dragging) {
      range.value = 100 * p.x;
      show();
    }
    if (dragging || event.pointerType === "mouse") {
      Object.assign(at, p);
      magnify();
    }
  });
  for (const end of ["pointerup", "pointercancel"]) frame.addEventListener(end, () => (dragging = false));
  frame.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.01, 0], ArrowRight: [0.01, 0], ArrowUp: [0, -0.01], ArrowDown: [0, 0.01] }[event.key];
    if (!step) return;
    event.preventDefault();
    at.x = Math.min(1, Math.max(0, at.x + step[0]));
    at.y = Math.min(1, Math.max(0, at.y + step[1]));
    magnify();
  });
  range.addEventListener("input", show);
  section.classList.add("live");
  show();
  Promise.all(images.map((image) => image.decode().catch(() => undefined))).then(magnify);
}
