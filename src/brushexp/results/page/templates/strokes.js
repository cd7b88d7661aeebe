// The strokes of a painting, as replay.py packs them: unpacked, drawn, and found under a pointer.
// brushexp.strokes(packed) has their numbers as arrays from the bottom up, lengths in pixels of the painting, and beside
// them lay, trace, reach and at.
"use strict";
{
  const STEPS = 65535; // of 16 bits
  const PIECES = 24; // of an outline
  const FAINTEST = 0.04; // opacity of strokes that can be pointed at

  function unpack({ count, data, box, widest, longest, layers: bounds, ...rest }) {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    let at = 0;
    const take = (Kind, each = 1) => {
      const array = new Kind(bytes.buffer, at, count * each);
      at += array.byteLength;
      return array;
    };
    const number = take(Uint32Array);
    const points = Float32Array.from(take(Uint16Array, 6), (value, k) =>
      box[k % 2] + (value / STEPS) * (box[2 + (k % 2)] - box[k % 2])); // x, y of the start, the control point and the end
    const half = Float32Array.from(take(Uint16Array), (value) => (0.5 * value * widest) / STEPS);
    const length = Float32Array.from(take(Uint16Array), (value) => (value * longest) / STEPS);
    const direction = Float32Array.from(take(Uint16Array), (value) => value === STEPS ? NaN : (180 * value) / (STEPS - 1));
    const paint = take(Uint8Array, 4);
    const visible = Float32Array.from(take(Uint8Array), (value) => value / 255);
    const layer = Uint8Array.from(half, (h, k) => {
      const area = 2 * h * length[k] + Math.PI * h * h;
      return (area > bounds[0]) + (area > bounds[1]);
    });
    const hex = (k) => `#${[...paint.subarray(4 * k, 4 * k + 3)].map((level) => level.toString(16).padStart(2, "0")).join("")}`;
    const color = Array.from({ length: count }, (_, k) => hex(k));
    const opacity = Float32Array.from({ length: count }, (_, k) => paint[4 * k + 3] / 255);
    return { ...rest, count, number, points, half, length, direction, color, opacity, visible, layer };
  }

  (window.brushexp ??= {}).strokes = (packed) => {
    const strokes = unpack(packed);
    const { taper, soft } = strokes;
    const probe = document.createElement("canvas").getContext("2d"); // for shapes alone
    probe.lineCap = "round";

    // Coverage at the middle of a stroke, see renderer/base.py: one thinner than its soft edge fades. It is drawn as wide
    // as leaves the paint the same.
    function peak(half) {
      const z = Math.min(0.5, half / soft);
      return 2 * z * (1.5 - 2 * z * z);
    }

    // How wide to each side a stroke is drawn.
    const reach = (k) => strokes.half[k] / (peak(strokes.half[k]) || 1);

    // Begin a path with the shape of stroke k, so wide to each side; gives how a pen draws it.
    function outline(pen, k, half) {
      const [x0, y0, x1, y1, x2, y2] = strokes.points.subarray(6 * k, 6 * k + 6);
      const end = half * (1 - taper); // half the width of an end
      pen.beginPath();
      if (Math.abs(x0 - x1) + Math.abs(y0 - y1) + Math.abs(x2 - x1) + Math.abs(y2 - y1) < 0.01) {
        pen.arc(x0, y0, end, 0, 2 * Math.PI);
        return "fill";
      }
      if (!taper) {
        pen.lineWidth = 2 * half;
        pen.moveTo(x0, y0);
        pen.quadraticCurveTo(x1, y1, x2, y2);
        return "stroke";
      }
      const left = []; // one side, and back on the other around the ends
      const right = [];
      let turn = 0;
      for (let i = 0; i <= PIECES; i++) {
        const t = i / PIECES;
        const [dx, dy] = [(1 - t) * (x1 - x0) + t * (x2 - x1), (1 - t) * (y1 - y0) + t * (y2 - y1)];
        if (dx || dy) turn = Math.atan2(dy, dx);
        const x = (1 - t) ** 2 * x0 + 2 * t * (1 - t) * x1 + t * t * x2;
        const y = (1 - t) ** 2 * y0 + 2 * t * (1 - t) * y1 + t * t * y2;
        const h = half * (1 - taper * (2 * t - 1) ** 2);
        left.push([x - Math.sin(turn) * h, y + Math.cos(turn) * h, turn]);
        right.unshift([x + Math.sin(turn) * h, y - Math.cos(turn) * h, turn]);
      }
      for (const [side, x, y] of [[left, x2, y2], [right, x0, y0]]) {
        for (const [px, py] of side) pen.lineTo(px, py);
        const from = side.at(-1)[2] + (side === left ? 0.5 : -0.5) * Math.PI;
        pen.arc(x, y, end, from, from - Math.PI, true);
      }
      return "fill";
    }

    // Draw the shape of stroke k in the colour that the pen has, so wide to each side.
    const trace = (pen, k, half) => pen[outline(pen, k, half)]();

    // Draw stroke k as it is.
    function lay(pen, k) {
      const strength = peak(strokes.half[k]);
      if (!strength) return;
      pen.globalAlpha = strokes.opacity[k] * strength;
      pen.fillStyle = pen.strokeStyle = strokes.color[k];
      trace(pen, k, reach(k));
    }

    // The uppermost of the first `shown` strokes at (x, y), pixels of the painting, in the chosen layers; -1 for none.
    // Thinner ones than `least` pixels to either side can be pointed at as if they were so wide.
    function at(x, y, shown, chosen, least) {
      const { points } = strokes;
      for (let k = shown - 1; k >= 0; k--) {
        const half = Math.max(strokes.half[k], least);
        const p = 6 * k;
        if (Math.min(points[p], points[p + 2], points[p + 4]) > x + half) continue;
        if (Math.max(points[p], points[p + 2], points[p + 4]) < x - half) continue;
        if (Math.min(points[p + 1], points[p + 3], points[p + 5]) > y + half) continue;
        if (Math.max(points[p + 1], points[p + 3], points[p + 5]) < y - half) continue;
        if (!chosen[strokes.layer[k]] || strokes.opacity[k] < FAINTEST) continue;
        if (outline(probe, k, half) === "fill" ? probe.isPointInPath(x, y) : probe.isPointInStroke(x, y)) return k;
      }
      return -1;
    }

    return Object.assign(strokes, { lay, trace, reach, at });
  };
}
