// Strokes pixel by pixel, by the formulas of the renderers' kernels (nearest.py, profile.py, texture_places.py):
// brushexp.brush(strokes) paints one over a picture.
"use strict";
{
  const SLOWEST = 1e-3; // as in frame.py: a curve slower than this fraction of its size has no direction
  const SLOWEST_PIXELS = 0.005;
  const PIECES = 8; // of a curve, each with its own bounding box
  const NEWTON = 4; // steps

  function curveOf([x0, y0, x1, y1, x2, y2]) {
    const [bx, by, fx, fy] = [x0 - 2 * x1 + x2, y0 - 2 * y1 + y2, x1 - x0, y1 - y0];
    const [a, b, c] = [bx * bx + by * by, 3 * (bx * fx + by * fy), 2 * (fx * fx + fy * fy)];
    const still = SLOWEST ** 2 * (fx * fx + fy * fy + (fx + bx) ** 2 + (fy + by) ** 2) + SLOWEST_PIXELS ** 2;
    const samples = a > 0.16 * ((x2 - x0) ** 2 + (y2 - y0) ** 2) ? 16 : 4;
    return { x0, y0, bx, by, fx, fy, a, b, c, still, samples, floor: 1e-6 * (a + Math.abs(b) + c) + 1e-20 };
  }

  // Pixels that pieces of a curve may touch: left, top, right and bottom.
  function boxesOf({ x0, y0, bx, by, fx, fy, a }, reach, zoom) {
    const points = Array.from({ length: PIECES + 1 }, (_, i) => i / PIECES);
    const places = points.map((t) => [x0 + t * (2 * fx + t * bx), y0 + t * (2 * fy + t * by)]);
    const wide = reach + Math.sqrt(a) / (4 * PIECES ** 2); // largest distance of a piece from its chord
    return places.slice(1).map(([x, y], i) => [
      Math.floor(zoom * (Math.min(x, places[i][0]) - wide)), Math.floor(zoom * (Math.min(y, places[i][1]) - wide)),
      Math.ceil(zoom * (Math.max(x, places[i][0]) + wide)), Math.ceil(zoom * (Math.max(y, places[i][1]) + wide)),
    ]);
  }

  // Parameter of the point on a curve nearest to a place: Newton's method from the best of some samples.
  function nearest(curve, x, y) {
    const { a, b, floor, samples } = curve;
    const mx = curve.x0 - x;
    const my = curve.y0 - y;
    const c = curve.c + curve.bx * mx + curve.by * my;
    const d = curve.fx * mx + curve.fy * my;
    let best = 0;
    let least = 0;
    for (let i = 1; i <= samples; i++) {
      const t = i / samples;
      const away = (((a * t * 0.25 + b / 3) * t + 0.5 * c) * t + d) * t;
      if (away < least) {
        best = t;
        least = away;
      }
    }
    const low = Math.max(0, best - 1 / samples);
    const high = Math.min(1, best + 1 / samples);
    for (let step = 0; step < NEWTON; step++) {
      const slope = ((a * best + b) * best + c) * best + d;
      const bend = (3 * a * best + 2 * b) * best + c;
      best = Math.min(high, Math.max(low, best - slope / Math.max(bend, floor)));
    }
    return best;
  }

  function rise(x) {
    const z = Math.min(0.5, Math.max(-0.5, x));
    return z * (1.5 - 2 * z * z);
  }

  (window.brushexp ??= {}).brush = (strokes) => {
    const { taper, texture } = strokes;
    const texels = texture && Uint8Array.from(atob(texture.texels), (letter) => letter.charCodeAt(0));
    const seen = { alpha: 0, tone: 0, along: 0 }; // of the last pixel

    // A stroke with a soft edge, whose colour may drift along it.
    function plain(k, curve) {
      const half = strokes.half[k];
      const opacity = strokes.opacity[k];
      const soft = strokes.soft + strokes.softness[k];
      const widening = strokes.widening[k];
      const look = (t, wx, wy) => {
        const distance = Math.sqrt(wx * wx + wy * wy);
        const along = 2 * t - 1;
        const wide = half * (1 - taper * along ** 2) * (1 + widening * along);
        seen.along = along;
        seen.alpha = opacity * Math.max(0, rise((wide + distance) / soft) + rise((wide - distance) / soft));
      };
      return { reach: half > 0 ? half * (1 + Math.abs(widening)) + soft / 2 : 0, look };
    }

    // A stroke with a texture along and across it, whose middle repeats.
    function textured(k, curve) {
      const [which, repeats, turned] = strokes.texture_of.subarray(3 * k, 3 * k + 3).map(Math.round);
      const [first, rows, columns, begins, loop, extent] = texture.sheets[which];
      const { spread, long } = texture;
      const opacity = strokes.strength[k] / 255;
      const scale = (0.5 * rows) / spread / strokes.thick[k];
      const flip = turned ? -scale : scale;
      const body = columns - rows / long + loop * (repeats - 1);
      const origin = rows / (2 * long) + 0.5;
      const outer = curve.fx * curve.by - curve.fy * curve.bx > 0 ? -1 : 1;
      const down = 2 * (columns + 2); // bytes from a texel to the one below it
      const look = (t, wx, wy) => {
        const dx = curve.fx + t * curve.bx;
        const dy = curve.fy + t * curve.by;
        const moves = dx * dx + dy * dy > curve.still;
        const tx = moves ? dx : outer * wy;
        const ty = moves ? dy : -outer * wx;
        const one = 1 / Math.sqrt(Math.max(tx * tx + ty * ty, 1e-30));
        let x = origin + body * t + (t > 0 && t < 1 ? 0 : (scale / long) * one * (tx * wx + ty * wy));
        if (loop && x >= begins) x -= loop * Math.min(Math.floor((x - begins) / loop), repeats - 1);
        x = Math.min(Math.max(x, 0), columns + 1);
        const y = Math.min(Math.max(0.5 * rows + 0.5 + flip * one * (tx * wy - ty * wx), 0), rows + 1);
        const left = Math.min(Math.floor(x), columns);
        const top = Math.min(Math.floor(y), rows);
        const [east, south] = [x - left, y - top];
        const [west, north] = [1 - east, 1 - south];
        const at = 2 * first + top * down + 2 * left;
        const mixed = (i) =>
          north * (west * texels[i] + east * texels[i + 2]) + south * (west * texels[i + down] + east * texels[i + down + 2]);
        seen.alpha = opacity * mixed(at);
        seen.tone = (mixed(at + 1) - 128) / 127;
      };
      return { reach: strokes.thick[k] * extent, look };
    }

    // Paint stroke k over a picture (ImageData) with `zoom` pixels per pixel of the painting.
    return (picture, k, zoom) => {
      const { data, width, height } = picture;
      const curve = curveOf(strokes.points.subarray(6 * k, 6 * k + 6));
      const { reach, look } = (texture ? textured : plain)(k, curve);
      if (!reach) return;
      const paint = strokes.paint.subarray(3 * k, 3 * k + 3);
      const drift = strokes.drift.subarray(3 * k, 3 * k + 3);
      const boxes = boxesOf(curve, reach, zoom);
      const last = Math.min(height, Math.max(...boxes.map((box) => box[3])));
      for (let row = Math.max(0, Math.min(...boxes.map((box) => box[1]))); row < last; row++) {
        const here = boxes.filter((box) => box[1] <= row && row < box[3]);
        const to = Math.min(width, Math.max(...here.map((box) => box[2])));
        const y = (row + 0.5) / zoom;
        for (let column = Math.max(0, Math.min(...here.map((box) => box[0]))); column < to; column++) {
          const x = (column + 0.5) / zoom;
          const t = nearest(curve, x, y);
          const wx = x - curve.x0 - t * (2 * curve.fx + t * curve.bx);
          const wy = y - curve.y0 - t * (2 * curve.fy + t * curve.by);
          if (wx * wx + wy * wy >= reach * reach) continue;
          look(t, wx, wy);
          const { alpha, tone, along } = seen;
          const pure = 255 * (1 - Math.abs(tone));
          const white = tone > 0 ? 255 * tone : 0;
          const i = 4 * (row * width + column);
          for (let c = 0; c < 3; c++) data[i + c] += alpha * (pure * (paint[c] + along * drift[c]) + white - data[i + c]);
        }
      }
    };
  };
}
