"use strict";
for (const box of document.querySelectorAll(".compare")) {
  const crops = [...box.querySelectorAll(".crop")], stage = box.querySelector(".stage"), range = box.querySelector("input");
  const show = () => {
    stage.querySelector(".over").src = crops[box.querySelector(".a").value].src;
    stage.querySelector(".under").src = crops[box.querySelector(".b").value].src;
  };
  const cut = () => stage.style.setProperty("--cut", range.value + "%");
  const follow = (event) => {
    const place = stage.getBoundingClientRect();
    range.value = 100 * (event.clientX - place.left) / place.width;
    cut();
  };
  box.querySelector(".a").addEventListener("change", show);
  box.querySelector(".b").addEventListener("change", show);
  range.addEventListener("input", cut);
  stage.addEventListener("pointerdown", (event) => { stage.setPointerCapture(event.pointerId); follow(event); });
  stage.addEventListener("pointermove", (event) => { if (event.buttons) follow(event); });
  show();
  cut();
}
