// The strokes of a painting, as replay.py packs them: unpacked, drawn, and found under a pointer.
// brushexp.strokes(about) has their numbers as arrays from the bottom up, lengths in pixels of the painting, and beside
// them lay, trace, reach and at.
"use strict";
{
  const brushexp = (window.brushexp ??= {});
  const STEPS = 65535; // of 16 bits
  const PIECES = 24; // of a curve when distances to it are measured, and of an outline
  const LEAST_ALPHA = 0.04; // of strokes that can be pointed at

  function unpack({ count, data, box, widest, longest, layers: bounds, ...rest }) {
    const text = atob(data);
    const bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    let at = 0;
    const take = (Kind, each = 1) => {
      const array = new Kind(bytes.buffer, at, count * each);
      at += array.byteLength;
      return array;
    };
    const number = take(Uint32Array);
    const packed = take(Uint16Array, 6);
    const half = Float32Array.from(take(Uint16Array), (value) => (0.5 * value * widest) / STEPS);
    const length = Float32Array.from(take(Uint16Array), (value) => (value * longest) / STEPS);
    const direction = Float32Array.from(take(Uint16Array), (value) => value === STEPS ? NaN : (180 * value) / (STEPS - 1));
    const paint = take(Uint8Array, 4);
    const visible = Float32Array.from(take(Uint8Array), (value) => value / 255);
    const points = Float32Array.from(packed, (value, k) => {
      const axis = k % 2;
      return box[axis] + (value / STEPS) * (box[2 + axis] - box[axis]);
    });
    const layer = Uint8Array.from(half, (h, k) => {
      const area = 2 * h * length[k] + Math.PI * h * h;
      return (area > bounds[0]) + (area > bounds[1]);
    });
    const hex = (k) => `#${[0, 1, 2].map((c) => paint[4 * k + c].toString(16).padStart(2, "0")).join("")}`;
    const color = Array.from({ length: count }, (_, k) => hex(k));
    const opacity = Float32Array.from({ length: count }, (_, k) => paint[4 * k + 3] / 255);
    return { ...rest, count, number, points, half, length, direction, color, opacity, visible, layer };
  }

  brushexp.strokes = (about) => {
    const strokes = unpack(about);
    let grid = null;

    // Coverage at the middle of a stroke, see renderer/base.py: one thinner than its soft edge fades. It is drawn as wide
    // as leaves the paint the same.
    function peak(half) {
      const z = Math.min(0.5, half / strokes.soft);
      return 2 * z * (1.5 - 2 * z * z);
    }

    // How wide to each side a stroke is drawn.
    function reach(k) {
      return strokes.half[k] / (peak(strokes.half[k]) || 1);
    }

    // Draw the shape of stroke k in the colour that the pen has, so wide to each side.
    function trace(pen, k, half) {
      const [x0, y0, x1, y1, x2, y2] = strokes.points.subarray(6 * k, 6 * k + 6);
      pen.beginPath();
      if (Math.abs(x0 - x1) + Math.abs(y0 - y1) + Math.abs(x2 - x1) + Math.abs(y2 - y1) < 0.01) {
        pen.arc(x0, y0, half * (1 - strokes.taper), 0, 2 * Math.PI);
        return pen.fill();
      }
      if (!strokes.taper) {
        pen.lineWidth = 2 * half;
        pen.moveTo(x0, y0);
        pen.quadraticCurveTo(x1, y1, x2, y2);
        return pen.stroke();
      }
      outline(pen, x0, y0, x1, y1, x2, y2, half);
      return pen.fill();
    }

    // A stroke with thinner ends: along one side, around the end, and back along the other.
    function outline(pen, x0, y0, x1, y1, x2, y2, half) {
      const sides = [[], []];
      let turn = 0;
      for (let i = 0; i <= PIECES; i++) {
        const t = i / PIECES;
        const dx = (1 - t) * (x1 - x0) + t * (x2 - x1);
        const dy = (1 - t) * (y1 - y0) + t * (y2 - y1);
        if (dx || dy) turn = Math.atan2(dy, dx);
        const x = (1 - t) ** 2 * x0 + 2 * t * (1 - t) * x1 + t * t * x2;
        const y = (1 - t) ** 2 * y0 + 2 * t * (1 - t) * y1 + t * t * y2;
        const h = half * (1 - strokes.taper * (2 * t - 1) ** 2);
        const [nx, ny] = [-Math.sin(turn) * h, Math.cos(turn) * h];
        sides[0].push([x + nx, y + ny, turn]);
        sides[1].push([x - nx, y - ny, turn]);
      }
      const h = half * (1 - strokes.taper);
      sides[0].forEach(([x, y]) => pen.lineTo(x, y));
      const lastTurn = sides[0][PIECES][2];
      pen.arc(x2, y2, h, lastTurn + Math.PI / 2, lastTurn - Math.PI / 2, true);
      sides[1].reverse().forEach(([x, y]) => pen.lineTo(x, y));
      const firstTurn = sides[0][0][2];
      pen.arc(x0, y0, h, firstTurn - Math.PI / 2, firstTurn - 1.5 * Math.PI, true);
    }

    // Draw stroke k as it is.
    function lay(pen, k) {
      const strength = peak(strokes.half[k]);
      if (!strength) return;
      pen.globalAlpha = strokes.opacity[k] * strength;
      pen.fillStyle = pen.strokeStyle = strokes.color[k];
      trace(pen, k, reach(k));
    }

    // Which strokes may be where: lists of strokes, from the bottom up, by square cells.
    function gridOf() {
      const cell = Math.max(4, Math.sqrt((strokes.width * strokes.height) / Math.min(strokes.count, 20000)));
      const columns = Math.ceil(strokes.width / cell);
      const rows = Math.ceil(strokes.height / cell);
      const cells = Array.from({ length: columns * rows }, () => []);
      const place = (value, most) => Math.max(0, Math.min(most - 1, Math.floor(value / cell)));
      for (let k = 0; k < strokes.count; k++) {
        const p = strokes.points.subarray(6 * k, 6 * k + 6);
        const bend = Math.hypot(p[0] - 2 * p[2] + p[4], p[1] - 2 * p[3] + p[5]) / 64;
        const far = reach(k) + bend + 1;
        for (let part = 0; part < 4; part++) {
          const [[ax, ay], [bx, by]] = [pointAt(p, part / 4), pointAt(p, (part + 1) / 4)];
          const [left, right] = [Math.min(ax, bx) - far, Math.max(ax, bx) + far];
          const [top, bottom] = [Math.min(ay, by) - far, Math.max(ay, by) + far];
          if (right < 0 || bottom < 0 || left > strokes.width || top > strokes.height) continue;
          for (let row = place(top, rows); row <= place(bottom, rows); row++) {
            for (let column = place(left, columns); column <= place(right, columns); column++) {
              const list = cells[row * columns + column];
              if (list[list.length - 1] !== k) list.push(k);
            }
          }
        }
      }
      return { at: (x, y) => cells[place(y, rows) * columns + place(x, columns)] };
    }

    function pointAt(p, t) {
      const [a, b, c] = [(1 - t) ** 2, 2 * t * (1 - t), t * t];
      return [a * p[0] + b * p[2] + c * p[4], a * p[1] + b * p[3] + c * p[5]];
    }

    // How far (x, y) is from the curve of stroke k, and at which parameter it is nearest.
    function nearest(k, x, y) {
      const p = strokes.points.subarray(6 * k, 6 * k + 6);
      let [best, parameter] = [Infinity, 0];
      let [ax, ay] = [p[0], p[1]];
      for (let i = 1; i <= PIECES; i++) {
        const [bx, by] = pointAt(p, i / PIECES);
        const [dx, dy] = [bx - ax, by - ay];
        const square = dx * dx + dy * dy;
        const share = square ? Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / square)) : 0;
        const away = Math.hypot(ax + share * dx - x, ay + share * dy - y);
        if (away < best) [best, parameter] = [away, (i - 1 + share) / PIECES];
        [ax, ay] = [bx, by];
      }
      return [best, parameter];
    }

    // The uppermost of the first `shown` strokes at (x, y), pixels of the painting, in the chosen layers; -1 for none.
    // Thinner ones than `least` pixels to either side can be pointed at as if they were so wide.
    function at(x, y, shown, chosen, least) {
      const list = (grid ??= gridOf()).at(x, y);
      for (let i = list.length - 1; i >= 0; i--) {
        const k = list[i];
        if (k >= shown || !chosen[strokes.layer[k]] || strokes.opacity[k] < LEAST_ALPHA) continue;
        const [away, t] = nearest(k, x, y);
        const half = strokes.half[k] * (1 - strokes.taper * (2 * t - 1) ** 2);
        if (away <= Math.max(half, least)) return k;
      }
      return -1;
    }

    return Object.assign(strokes, { lay, trace, reach, at });
  };
}
