// The painting laid down again, stroke by stroke, on a canvas: play, scrub, look at single strokes, leave out layers.
//
// What is shown is always the first `shown` strokes of those in the chosen layers. Every few hundred strokes the canvas
// is kept as it is (a key frame), so that going back costs no more than drawing from the last one; since a key frame is
// a copy, the same place always looks the same. Work is done in slices, so that the page stays responsive.
"use strict";
{
  const KEY_MEMORY = 96 * 2 ** 20; // bytes of key frames
  const KEY_STROKES = 250; // between two key frames, if they fit
  const SLICE = 10; // milliseconds of drawing in one frame
  const SECONDS = 20; // for the whole painting at speed 1
  const EASE = 1.6; // the first strokes, large ones, are laid more slowly
  const MOST_PIXELS = 2.5e6; // of the canvas: more are slow to show where there is no graphics card
  const LAYERS = ["small", "medium", "large"];

  const stage = document.querySelector("#replay-stage");
  const strokes = window.brushexp.strokes(JSON.parse(document.querySelector("#strokes").textContent));
  const canvas = stage.querySelector(".replay-paint");
  const over = stage.querySelector(".replay-over");
  const end = stage.querySelector(".replay-end"); // the painting itself, where strokes have more than a canvas can draw
  const context = canvas.getContext("2d", { alpha: false });
  const play = document.querySelector("#play");
  const scrubber = document.querySelector("#scrubber");
  const position = document.querySelector("#position");
  const speed = document.querySelector("#speed");
  const layers = [...document.querySelectorAll("[data-layer]")];
  const card = document.querySelector("#stroke"); // what is known of the selected stroke
  const label = stage.querySelector(".replay-label"); // the same in short, for narrow screens

  let scale = 0; // device pixels per pixel of the painting; 0 before anything is drawn
  let shown = 0; // strokes that are on the canvas
  let goal = strokes.count; // strokes that should be
  let keys = new Map(); // number of strokes -> canvas
  let every = KEY_STROKES;
  let chosen = [true, true, true]; // layers, small to large
  let playing = false;
  let played = 0; // share of the time
  let last = 0; // when the last frame was
  let waiting = false; // for a frame
  let selected = -1; // stroke, counted from the bottom
  let pinned = false; // stays selected when the pointer goes away

  // ---- drawing ----

  function measure() {
    const ratio = Math.min(devicePixelRatio || 1, 3);
    const wanted = (stage.clientWidth * ratio) / strokes.width;
    const most = Math.sqrt(MOST_PIXELS / (strokes.width * strokes.height));
    const width = Math.max(1, Math.round(strokes.width * Math.min(wanted, most)));
    const height = Math.max(1, Math.round((width * strokes.height) / strokes.width));
    if (!stage.clientWidth || (scale && width === canvas.width && height === canvas.height)) return;
    for (const one of [canvas, over]) [one.width, one.height] = [width, height];
    scale = width / strokes.width;
    const fit = Math.max(4, Math.floor(KEY_MEMORY / (4 * width * height)));
    every = Math.max(KEY_STROKES, Math.ceil(strokes.count / fit));
    begin();
  }

  function begin() {
    keys = new Map();
    clear();
    request();
  }

  function clear() {
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = 1;
    context.fillStyle = strokes.background;
    context.fillRect(0, 0, canvas.width, canvas.height);
    shown = 0;
  }

  function restore(count) {
    const key = keys.get(count);
    if (!key) return clear();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = 1;
    context.drawImage(key, 0, 0);
    shown = count;
  }

  function keep() {
    const key = document.createElement("canvas");
    [key.width, key.height] = [canvas.width, canvas.height];
    key.getContext("2d", { alpha: false }).drawImage(canvas, 0, 0);
    keys.set(shown, key);
  }

  // Go towards the goal for some milliseconds; the rest is done in the next frames.
  function advance() {
    let from = Math.floor(goal / every) * every;
    while (from && !keys.has(from)) from -= every;
    if (goal < shown || from > shown) restore(from);
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.lineCap = "round";
    const until = performance.now() + SLICE;
    while (shown < goal) {
      if (chosen[strokes.layer[shown]]) strokes.lay(context, shown);
      shown++;
      if (shown % every === 0 && !keys.has(shown)) keep();
      if (shown % 8 === 0 && performance.now() > until) break;
    }
  }

  function request() {
    if (waiting || !scale) return;
    waiting = true;
    requestAnimationFrame(frame);
  }

  function frame(now) {
    waiting = false;
    if (playing) {
      played += (Math.min(100, now - last) / 1000) * (speed.value / SECONDS);
      last = now;
      goal = Math.round(strokes.count * Math.min(1, played) ** EASE);
      if (played >= 1) pause();
    }
    advance();
    show();
    if (playing || shown !== goal) request();
  }

  function show() {
    const done = shown === goal;
    const whole = goal === strokes.count && chosen.every(Boolean);
    if (done || stage.dataset.live) stage.dataset.live = "yes"; // until then the finished painting stands there
    if (end) end.hidden = !(whole && done && !strokes.exact) && stage.dataset.live === "yes";
    scrubber.value = goal;
    scrubber.style.setProperty("--at", `${(100 * goal) / strokes.count}%`);
    scrubber.setAttribute("aria-valuetext", `${goal} of ${strokes.count} strokes`);
    position.textContent = `${goal.toLocaleString("en")} of ${strokes.count.toLocaleString("en")}`;
    stage.dataset.shown = shown;
    stage.dataset.busy = String(!done);
  }

  function go(count) {
    goal = Math.max(0, Math.min(strokes.count, Math.round(count)));
    stage.dataset.live = "yes";
    stage.dataset.busy = "true";
    request();
  }

  function start() {
    playing = true;
    if (goal >= strokes.count) [goal, played] = [0, 0];
    else played = (goal / strokes.count) ** (1 / EASE);
    last = performance.now();
    stage.dataset.live = "yes";
    select(-1);
    tell();
    request();
  }

  function pause() {
    playing = false;
    tell();
  }

  function tell() {
    play.textContent = playing ? "Pause" : "Play";
    stage.dataset.playing = String(playing);
  }

  // ---- pointing at strokes ----

  function select(k, stay = false) {
    pinned = stay && k >= 0;
    if (k === selected) return;
    selected = k;
    stage.dataset.selected = k < 0 ? "" : strokes.number[k];
    describe(k);
    light(k);
  }

  function describe(k) {
    card.dataset.empty = String(k < 0);
    label.hidden = k < 0;
    if (k < 0) return;
    const round = (value, digits = 1) => value.toFixed(digits);
    const turn = strokes.direction[k];
    const words = {
      number: strokes.number[k].toLocaleString("en"),
      depth: `${(k + 1).toLocaleString("en")} of ${strokes.count.toLocaleString("en")}`,
      length: `${round(strokes.length[k])} px`,
      width: `${round(2 * strokes.half[k])} px`,
      direction: Number.isNaN(turn) ? "none, a dot" : `${Math.round(turn) % 180}°`,
      opacity: `${Math.round(100 * strokes.opacity[k])} %`,
      visible: `${Math.round(100 * strokes.visible[k])} %`,
      layer: LAYERS[strokes.layer[k]],
      color: strokes.color[k],
    };
    for (const [name, text] of Object.entries(words)) card.querySelector(`[data-field=${name}]`).textContent = text;
    label.textContent = `${words.number}: ${words.length} × ${words.width}, ${words.direction}`;
    card.querySelector(".swatch").style.background = strokes.color[k];
    card.querySelector(".needle").style.rotate = `${Number.isNaN(turn) ? 0 : turn}deg`;
  }

  // The selected stroke in its own colour, with a rim, before the others in the shade.
  function light(k) {
    const pen = over.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, over.width, over.height);
    over.hidden = k < 0;
    if (k < 0 || !scale) return;
    pen.globalAlpha = 0.45;
    pen.fillStyle = "#000";
    pen.fillRect(0, 0, over.width, over.height);
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.lineCap = "round";
    pen.globalAlpha = 1;
    const pixel = devicePixelRatio / scale;
    for (const [rim, color] of [[3, "#000"], [2, "#fff"], [0, strokes.color[k]]]) {
      pen.fillStyle = pen.strokeStyle = color;
      strokes.trace(pen, k, strokes.reach(k) + rim * pixel);
    }
  }

  function under(event) {
    const box = stage.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * strokes.width;
    const y = ((event.clientY - box.top) / box.height) * strokes.height;
    return strokes.at(x, y, shown, chosen, scale ? devicePixelRatio / scale : 1); // a pixel of the page at least
  }

  function step(by) {
    pause();
    go(goal + by);
    const k = goal - 1;
    select(k, true);
  }

  // ---- what people do ----

  stage.addEventListener("pointermove", (event) => {
    if (event.pointerType !== "touch" && !pinned && !playing && shown === goal) select(under(event));
  });
  stage.addEventListener("pointerleave", () => { if (!pinned) select(-1); });
  stage.addEventListener("click", (event) => {
    if (playing) return pause();
    const k = under(event);
    return pinned && k === selected ? select(k) : select(k, true);
  });
  stage.addEventListener("keydown", (event) => {
    const by = event.shiftKey ? 100 : 1;
    const moves = {
      ArrowRight: () => step(by), ArrowUp: () => step(by), ArrowLeft: () => step(-by), ArrowDown: () => step(-by),
      Home: () => step(-strokes.count), End: () => step(strokes.count),
      " ": () => (playing ? pause() : start()), Escape: () => select(-1),
    };
    if (!moves[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    moves[event.key]();
  });
  play.addEventListener("click", () => (playing ? pause() : start()));
  scrubber.addEventListener("input", () => {
    pause();
    select(-1);
    go(Number(scrubber.value));
  });
  for (const box of layers) {
    const which = LAYERS.indexOf(box.dataset.layer);
    const count = strokes.layer.reduce((sum, layer) => sum + (layer === which), 0);
    box.closest(".chip").title = `${count.toLocaleString("en")} strokes`;
    box.addEventListener("change", () => {
      chosen[which] = box.checked;
      select(-1);
      stage.dataset.live = "yes";
      stage.dataset.busy = "true";
      begin();
    });
  }
  tell();
  show();

  let later = 0;
  new ResizeObserver(() => {
    clearTimeout(later);
    if (scale) later = setTimeout(measure, 150);
  }).observe(stage);
  new IntersectionObserver((entries, observer) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    measure();
  }, { rootMargin: "300px" }).observe(stage);
}
