// Show the photograph and its strokes on a canvas: move, zoom, and select a stroke.
"use strict";
{
  const { byId, recovered, marks } = window.brushexp;
  const { data, count, isShown, colorOf, inUnit, unitOf, plain } = recovered;
  const { columns, outlines, colors, width, height, mm } = data;
  const [stage, canvas, photograph] = ["look-at", "canvas", "photograph"].map(byId);
  const pen = canvas.getContext("2d");
  const CLOSEST = 32; // screen pixels per pixel of the photograph
  const STEP = 1.4; // factor of the zoom buttons
  const TAP = 5; // pixels that a pointer may move during a tap
  const paths = outlines.map((points) => {
    const path = new Path2D();
    points.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
    path.closePath();
    return path;
  });
  const boxes = outlines.map((points) => [0, 1].flatMap((k) => [Math.min, Math.max].map((f) => f(...points.map((point) => point[k])))));
  const view = { zoom: 1, x: 0, y: 0 }; // screen pixels per pixel; position in the upper left corner
  let picked = -1;
  let waits = false;
  let byTyping = false; // whether the last event was a key, in which case a cross marks where Enter acts

  const whole = () => Math.min(canvas.clientWidth / width, canvas.clientHeight / height);
  const within = (zoom) => Math.min(Math.max(zoom, Math.min(whole(), 1)), Math.max(whole(), CLOSEST));
  const clamp = () => {
    view.zoom = within(view.zoom);
    for (const [axis, side, extent] of [["x", width, canvas.clientWidth], ["y", height, canvas.clientHeight]]) {
      const seen = extent / view.zoom;
      view[axis] = seen >= side ? (side - seen) / 2 : Math.min(Math.max(view[axis], 0), side - seen);
    }
  };
  const isOn = (layer) => document.querySelector(`[data-layer=${layer}]`).checked;

  const paint = () => {
    waits = false;
    const ratio = devicePixelRatio || 1;
    const size = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.round(side * ratio));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    clamp();
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, ...size);
    const zoom = view.zoom * ratio;
    pen.setTransform(zoom, 0, 0, zoom, -view.x * zoom, -view.y * zoom);
    pen.imageSmoothingEnabled = view.zoom < 3;
    if (isOn("photograph")) pen.drawImage(photograph, 0, 0, width, height);
    const [right, bottom] = [view.x + canvas.clientWidth / view.zoom, view.y + canvas.clientHeight / view.zoom];
    const [lines, filled] = [isOn("outlines"), isOn("filled")];
    pen.lineJoin = "round";
    for (let k = 0; k < count && !marks.isOpen(); k++) {
      const [left, end, top, low] = boxes[k];
      if (!isShown(k) || left > right || end < view.x || top > bottom || low < view.y) continue;
      const color = colorOf(k);
      if (filled) {
        pen.globalAlpha = 0.75;
        pen.fillStyle = color;
        pen.fill(paths[k]);
        pen.globalAlpha = 1;
      }
      if (lines) outline(paths[k], color, view.zoom < 1 ? 1 : 1.4);
    }
    if (marks.isOpen()) marks.paint(pen, view.zoom, marks.isBusy() && byTyping ? placeAt() : null);
    else if (picked >= 0) outline(paths[picked], "#ffffff", 3);
    byId("scale").textContent = `${Math.round(100 * view.zoom)} %` + (mm ? `, ${plain(100 * mm / view.zoom)} mm on 100 pixels` : "");
  };
  const outline = (path, color, wide) => {
    for (const [style, extra] of [["rgb(0 0 0 / 55%)", 1.6], [color, 0]]) {
      pen.strokeStyle = style;
      pen.lineWidth = (wide + extra) / view.zoom;
      pen.stroke(path);
    }
  };
  const repaint = () => {
    if (!waits) requestAnimationFrame(paint);
    waits = true;
  };

  const zoomAt = (factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) => {
    const [px, py] = [view.x + x / view.zoom, view.y + y / view.zoom];
    view.zoom = within(view.zoom * factor);
    [view.x, view.y] = [px - x / view.zoom, py - y / view.zoom];
    repaint();
  };
  const move = (x, y) => {
    view.x -= x / view.zoom;
    view.y -= y / view.zoom;
    repaint();
  };
  const fit = () => {
    view.zoom = whole();
    repaint();
  };

  const placeAt = (x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) => [view.x + x / view.zoom, view.y + y / view.zoom];
  const at = (x, y) => {
    const [px, py] = placeAt(x, y);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    for (let k = count - 1; k >= 0; k--) {
      const [left, right, top, bottom] = boxes[k];
      if (isShown(k) && px >= left && px <= right && py >= top && py <= bottom && pen.isPointInPath(paths[k], px, py)) return k;
    }
    return -1;
  };
  const pick = (k) => {
    picked = k;
    const card = byId("stroke");
    card.dataset.empty = k < 0;
    repaint();
    if (k < 0) return;
    const field = (name, text) => { card.querySelector(`[data-field=${name}]`).textContent = text; };
    field("stroke", columns.stroke[k]);
    for (const name of ["confidence", "length", "width", "area", "curvature", "elongatedness"]) {
      const [value, unit] = [columns[name][k], unitOf(name)];
      const pixels = mm && inUnit(name, value) !== value ? ` (${plain(value)} px${unit.endsWith("²") ? "²" : ""})` : "";
      field(name, plain(inUnit(name, value)) + (unit === "°" ? unit : ` ${unit}`) + pixels);
    }
    field("direction", `${Math.round(columns.direction[k]) % 180}° clockwise`);
    field("order", `${columns.order[k] + 1} of ${count}, from the bottom`);
    field("colour", colors[k]);
    card.querySelector(".swatch").style.background = colors[k];
    card.querySelector(".needle").style.transform = `rotate(${columns.direction[k]}deg)`;
  };

  const tapMark = (place) => {
    pen.setTransform(1, 0, 0, 1, 0, 0);
    marks.tap(pen, placeAt(...place));
  };
  const enter = () => {
    if (!marks.isBusy()) return;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    marks.enter(pen, placeAt());
  };

  const held = new Map(); // positions of the pressed pointers
  let moved = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  stage.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    stage.setPointerCapture(event.pointerId);
    held.set(event.pointerId, place(event));
    moved = held.size > 1 ? Infinity : 0;
    byTyping = false;
  });
  stage.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) return;
    const [before, now] = [held.get(event.pointerId), place(event)];
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    held.set(event.pointerId, now);
    moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (moved > TAP) stage.dataset.moving = "";
    if (!other && marks.takesDrags()) {
      if (moved <= TAP) return undefined;
      marks.drag(placeAt(...before), view.zoom);
      marks.drag(placeAt(...now), view.zoom);
      return repaint();
    }
    if (!other) return moved > TAP ? move(now[0] - before[0], now[1] - before[1]) : undefined;
    const [far, near] = [now, before].map((point) => Math.hypot(point[0] - other[0], point[1] - other[1]));
    return zoomAt(far / Math.max(near, 1), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
  });
  for (const kind of ["pointerup", "pointercancel"])
    stage.addEventListener(kind, (event) => {
      if (held.delete(event.pointerId) && kind === "pointerup") {
        if (marks.takesDrags()) marks.drop();
        else if (moved <= TAP && marks.isBusy()) tapMark(place(event));
        else if (moved <= TAP && !marks.isOpen()) pick(at(...place(event)));
      }
      delete stage.dataset.moving;
    });
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoomAt(Math.exp(-event.deltaY / 400), ...place(event));
  }, { passive: false });
  const keys = { "+": () => zoomAt(STEP), "=": () => zoomAt(STEP), "-": () => zoomAt(1 / STEP), 0: fit, Enter: enter, ...marks.keys };
  keys.Escape = () => {
    pick(-1);
    marks.leave();
  };
  for (const [key, x, y] of [["ArrowLeft", 60, 0], ["ArrowRight", -60, 0], ["ArrowUp", 0, 60], ["ArrowDown", 0, -60]]) keys[key] = (fine) => move(fine ? x / 10 : x, fine ? y / 10 : y);
  stage.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    byTyping = true;
    keys[event.key](event.shiftKey);
    repaint();
  });
  const buttons = { in: () => zoomAt(STEP), out: () => zoomAt(1 / STEP), fit, one: () => zoomAt(1 / view.zoom) };
  for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", buttons[button.dataset.zoom]);
  for (const box of document.querySelectorAll("[data-layer]")) box.addEventListener("input", repaint);
  document.addEventListener("shown", () => {
    if (picked >= 0 && !isShown(picked)) pick(-1);
    repaint();
  });
  document.addEventListener("marked", repaint);
  new ResizeObserver(repaint).observe(stage);
  fit();
}
