// Replay the painting stroke by stroke on a canvas: play, scrub, inspect single strokes, hide layers. The canvas
// always shows the first `shown` strokes of the chosen layers. A dozen copies of the canvas (key frames) are kept, so
// going back only redraws from the nearest one, and the same place always looks the same. Drawing runs in slices, so
// the page stays responsive.
"use strict";
{
  const KEYS = 12; // key frames
  const SLICE = 10; // milliseconds of drawing per frame
  const SECONDS = 20; // for the whole painting at speed 1
  const MOST_PIXELS = 2e6; // of the canvas: more would be slow to show and need large key frames
  const LAYERS = ["small", "medium", "large"];

  const { byId, strokes: unpacked } = window.brushexp;
  const [stage, play, scrubber, speed] = ["replay-stage", "play", "scrubber", "speed"].map(byId);
  const card = byId("stroke"); // data of the selected stroke
  const [canvas, over] = stage.querySelectorAll("canvas");
  const end = stage.querySelector(".replay-end"); // the finished painting, if a canvas cannot draw all of it
  const lamp = stage.querySelector(".replay-light"); // the effect of its light on the colours
  const context = canvas.getContext("2d", { alpha: false });
  const strokes = unpacked(JSON.parse(byId("strokes").textContent));
  const every = Math.ceil(strokes.count / KEYS);
  const [red, green, blue] = [1, 3, 5].map((at) => Number(`0x${strokes.background.slice(at, at + 2)}`));
  const [bare] = new Uint32Array(Uint8Array.of(red, green, blue, 255).buffer);

  let scale = 0; // device pixels per pixel of the painting; 0 before anything is drawn
  let picture = null; // content of the canvas, without the lamp
  let shown = 0; // strokes in the picture
  let goal = strokes.count; // strokes to show
  let keys = new Map(); // number of strokes -> the picture's bytes
  const chosen = [true, true, true]; // layers, small to large
  let playing = false;
  let played = 0; // strokes played so far, including fractions
  let last = 0; // time of the last frame
  let waiting = false; // for a frame
  let selected = -1; // stroke, counted from the bottom
  let pinned = false; // stays selected when the pointer leaves

  const thousands = (count) => count.toLocaleString("en");

  // ---- drawing ----
  function measure() {
    const ratio = Math.min(devicePixelRatio || 1, 3);
    const most = Math.sqrt(MOST_PIXELS / (strokes.width * strokes.height));
    const wanted = Math.min((stage.clientWidth * ratio) / strokes.width, most);
    const width = Math.max(1, Math.round(strokes.width * wanted));
    const height = Math.max(1, Math.round((width * strokes.height) / strokes.width));
    if (!stage.clientWidth || (scale && width === canvas.width && height === canvas.height)) return;
    for (const one of [canvas, over]) [one.width, one.height] = [width, height];
    picture = context.createImageData(width, height);
    scale = width / strokes.width;
    begin();
  }

  // Redraw everything.
  function begin() {
    keys = new Map();
    restore(0);
    request();
  }

  // Return to a key frame; the first is the bare canvas.
  function restore(count) {
    if (count) picture.data.set(keys.get(count));
    else new Uint32Array(picture.data.buffer).fill(bare);
    shown = count;
  }

  // Draw towards the goal for some milliseconds, and continue in the next frames.
  function advance() {
    let from = Math.floor(goal / every) * every;
    while (from && !keys.has(from)) from -= every;
    if (goal < shown || from > shown) restore(from);
    const until = performance.now() + SLICE;
    while (shown < goal && performance.now() < until) {
      if (chosen[strokes.layer[shown]]) strokes.lay(picture, shown, scale);
      shown++;
      if (shown % every === 0 && !keys.has(shown)) keys.set(shown, picture.data.slice());
    }
    context.putImageData(picture, 0, 0);
    if (lamp && shown === strokes.count && chosen.every(Boolean)) {
      context.drawImage(lamp, 0, 0, canvas.width, canvas.height); // lit once all strokes are drawn
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
      const passed = Math.max(0, Math.min(100, now - last)); // a frame may have begun before the click
      played += (passed / 1000) * strokes.count * (speed.value / SECONDS);
      last = now;
      goal = Math.min(strokes.count, Math.round(played));
      if (goal === strokes.count) run(false);
    }
    advance();
    show();
    if (playing || shown !== goal) request();
  }

  function show() {
    const done = shown === goal;
    const whole = goal === strokes.count && chosen.every(Boolean);
    if (done) stage.dataset.live = "yes"; // until then the finished painting is shown
    if (end) end.hidden = !(whole && done && !strokes.exact) && stage.dataset.live === "yes";
    scrubber.value = goal;
    scrubber.setAttribute("aria-valuetext", `${goal} of ${strokes.count} strokes`);
    byId("position").textContent = `${thousands(goal)} of ${thousands(strokes.count)}`;
    Object.assign(stage.dataset, { shown, busy: !done });
  }

  function go(count) {
    goal = Math.max(0, Math.min(strokes.count, Math.round(count)));
    Object.assign(stage.dataset, { live: "yes", busy: true });
    request();
  }

  // Play from here, or from the beginning after the last stroke; or pause.
  function run(on) {
    playing = on;
    play.textContent = on ? "Pause" : "Play";
    stage.dataset.playing = on;
    if (!on) return;
    played = goal % strokes.count;
    last = performance.now();
    select(-1);
    go(played);
  }

  // ---- pointing at strokes ----
  function select(k, stay = false) {
    pinned = stay && k >= 0;
    if (k === selected) return;
    selected = k;
    card.dataset.empty = k < 0;
    if (k >= 0) describe(k);
    light(k);
  }

  function describe(k) {
    const [turn, colors] = [strokes.direction[k], strokes.colors(k)];
    const words = {
      number: String(strokes.number[k]), // as in all files
      depth: `${thousands(k + 1)} of ${thousands(strokes.count)}`,
      length: `${strokes.length[k].toFixed(1)} px`,
      width: `${(2 * strokes.half[k]).toFixed(1)} px`,
      direction: turn < 0 ? "none, a dot" : `${Math.round(turn) % 180}°`,
      colour: colors.join(" to "),
      opacity: `${Math.round(100 * strokes.opacity[k])} %`,
      visible: `${Math.round(100 * strokes.visible[k])} %`,
      size: LAYERS[strokes.layer[k]],
    };
    for (const [name, text] of Object.entries(words)) card.querySelector(`[data-field=${name}]`).textContent = text;
    card.querySelector(".swatch").style.background = `linear-gradient(90deg, ${colors[0]}, ${colors.at(-1)})`;
    card.querySelector(".needle").style.rotate = `${Math.max(0, turn)}deg`;
  }

  // The selected stroke in its own colour, with a rim; the others are darkened.
  function light(k) {
    const pen = over.getContext("2d");
    pen.reset();
    over.hidden = k < 0;
    if (k < 0 || !scale) return;
    pen.fillStyle = "rgb(0 0 0 / 45%)";
    pen.fillRect(0, 0, over.width, over.height);
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.lineCap = "round";
    for (const [rim, color] of [[3, "#000"], [2, "#fff"], [0, strokes.color[k]]]) {
      pen.fillStyle = pen.strokeStyle = color;
      strokes.trace(pen, k, strokes.reach(k) + (rim * devicePixelRatio) / scale);
    }
  }

  function under(event) {
    const box = stage.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * strokes.width;
    const y = ((event.clientY - box.top) / box.height) * strokes.height;
    return strokes.at(x, y, shown, chosen, scale ? devicePixelRatio / scale : 1); // at least one pixel of the page
  }

  // ---- events ----
  stage.addEventListener("pointermove", (event) => {
    if (event.pointerType !== "touch" && !pinned && !playing && shown === goal) select(under(event));
  });
  stage.addEventListener("pointerleave", () => { if (!pinned) select(-1); });
  stage.addEventListener("click", (event) => {
    const k = playing ? -1 : under(event);
    run(false);
    select(k, !(pinned && k === selected)); // a second click deselects
  });
  stage.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const by = event.shiftKey ? 100 : 1;
    const steps = {
      ArrowRight: by, ArrowUp: by, ArrowLeft: -by, ArrowDown: -by, Home: -strokes.count, End: strokes.count,
    };
    if (event.key === " ") run(!playing);
    else if (event.key === "Escape") select(-1);
    else if (event.key in steps) {
      run(false);
      go(goal + steps[event.key]);
      select(goal - 1, true);
    } else return;
    event.preventDefault();
  });
  play.addEventListener("click", () => run(!playing));
  scrubber.addEventListener("input", () => {
    run(false);
    select(-1);
    go(Number(scrubber.value));
  });
  for (const box of document.querySelectorAll("[data-layer]")) {
    box.addEventListener("change", () => {
      chosen[LAYERS.indexOf(box.dataset.layer)] = box.checked;
      select(-1);
      go(goal);
      begin();
    });
  }
  addEventListener("resize", () => { if (scale) measure(); });
  run(false);
  show();
  Promise.resolve(lamp?.decode()).then(measure);
}
