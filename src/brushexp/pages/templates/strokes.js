// Unpack the strokes of a painting (packed by replay.py), draw them (brush.js), and find them under a pointer.
// brushexp.strokes(packed) has arrays from the bottom stroke up, and the functions lay, trace, reach and at.
"use strict";
{
  const STEPS = 65535; // of 16 bits
  const PIECES = 24; // of an outline
  const FAINTEST = 0.04; // least opacity of strokes that a pointer finds

  function unpack({ count, data, columns, ...rest }) {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const strokes = { ...rest, count, number: new Uint32Array(bytes.buffer, 0, count) };
    let at = strokes.number.byteLength;
    for (const [name, each, low, high] of columns) {
      const packed = new Uint16Array(bytes.buffer, at, count * each);
      strokes[name] = Float32Array.from(packed, (value) => low + (value / STEPS) * (high - low));
      at += packed.byteLength;
    }
    for (const name of ["softness", "widening", "drift"]) strokes[name] ??= new Float32Array(3 * count);
    const hex = (share) => Math.round(255 * share).toString(16).padStart(2, "0");
    const channel = (i, along) => hex(Math.min(1, Math.max(0, strokes.paint[i] + along * strokes.drift[i])));
    const colorAt = (k, along) => `#${[3 * k, 3 * k + 1, 3 * k + 2].map((i) => channel(i, along)).join("")}`;
    strokes.color = Array.from({ length: count }, (_, k) => colorAt(k, 0));
    strokes.colors = (k) => [...new Set([colorAt(k, -1), colorAt(k, 1)])]; // at its start and end, if they differ
    return strokes;
  }

  (window.brushexp ??= {}).strokes = (packed) => {
    const strokes = unpack(packed);
    const { taper } = strokes;
    const probe = new OffscreenCanvas(1, 1).getContext("2d"); // only for shapes
    probe.lineCap = "round";

    // Coverage at the middle of a stroke, see renderer/base.py: a stroke thinner than its soft edge fades. Its drawn
    // width keeps the amount of paint.
    function peak(k) {
      const z = Math.min(0.5, strokes.half[k] / (strokes.soft + strokes.softness[k]));
      return 2 * z * (1.5 - 2 * z * z);
    }

    // Half the drawn width of stroke k.
    const reach = (k) => strokes.half[k] / (peak(k) || 1);

    // Begin a path with the shape of stroke k of this half width, and return how the pen draws it.
    function outline(pen, k, wide) {
      const [x0, y0, x1, y1, x2, y2] = strokes.points.subarray(6 * k, 6 * k + 6);
      const widening = strokes.widening[k];
      const halfAt = (t) => wide * (1 - taper * (2 * t - 1) ** 2) * (1 + widening * (2 * t - 1));
      pen.beginPath();
      if (Math.abs(x0 - x1) + Math.abs(y0 - y1) + Math.abs(x2 - x1) + Math.abs(y2 - y1) < 0.01) {
        pen.arc(x0, y0, wide * (1 - taper), 0, 2 * Math.PI);
        return "fill";
      }
      if (!taper && !widening) {
        pen.lineWidth = 2 * wide;
        pen.moveTo(x0, y0);
        pen.quadraticCurveTo(x1, y1, x2, y2);
        return "stroke";
      }
      const right = []; // the right side, traced backwards
      let [turn, first] = [0, null];
      for (let i = 0; i <= PIECES; i++) {
        const t = i / PIECES;
        const [dx, dy] = [(1 - t) * (x1 - x0) + t * (x2 - x1), (1 - t) * (y1 - y0) + t * (y2 - y1)];
        if (dx || dy) turn = Math.atan2(dy, dx);
        first ??= turn;
        const x = (1 - t) ** 2 * x0 + 2 * t * (1 - t) * x1 + t * t * x2;
        const y = (1 - t) ** 2 * y0 + 2 * t * (1 - t) * y1 + t * t * y2;
        const h = halfAt(t);
        pen.lineTo(x - Math.sin(turn) * h, y + Math.cos(turn) * h);
        right.unshift([x + Math.sin(turn) * h, y - Math.cos(turn) * h]);
      }
      pen.arc(x2, y2, halfAt(1), turn + Math.PI / 2, turn - Math.PI / 2, true);
      for (const [x, y] of right) pen.lineTo(x, y);
      pen.arc(x0, y0, halfAt(0), first - Math.PI / 2, first - 1.5 * Math.PI, true);
      return "fill";
    }

    // Draw the shape of stroke k in the pen's colour, with this half width.
    const trace = (pen, k, wide) => pen[outline(pen, k, wide)]();

    // The uppermost of the first `shown` strokes at (x, y), pixels of the painting, in the chosen layers; -1 for none.
    // Strokes thinner than `least` pixels to either side count as that wide.
    function at(x, y, shown, chosen, least) {
      const isBeside = (a, b, c, place, wide) => Math.min(a, b, c) > place + wide || Math.max(a, b, c) < place - wide;
      for (let k = shown - 1; k >= 0; k--) {
        if (!chosen[strokes.layer[k]] || strokes.opacity[k] < FAINTEST) continue;
        const wide = Math.max(strokes.half[k], least);
        const most = wide * (1 + Math.abs(strokes.widening[k]));
        const [x0, y0, x1, y1, x2, y2] = strokes.points.subarray(6 * k, 6 * k + 6);
        if (isBeside(x0, x1, x2, x, most) || isBeside(y0, y1, y2, y, most)) continue;
        if (outline(probe, k, wide) === "fill" ? probe.isPointInPath(x, y) : probe.isPointInStroke(x, y)) return k;
      }
      return -1;
    }

    return Object.assign(strokes, { lay: window.brushexp.brush(strokes), trace, reach, at });
  };
}
