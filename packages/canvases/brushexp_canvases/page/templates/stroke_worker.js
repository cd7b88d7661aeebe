// Worker that draws strokes of cells into tiles and finds the stroke under a pointer, using brush.js and strokes.js.
// Plain strokes are crisp shapes at any zoom, as in an SVG; strokes that are textured, soft or change colour are drawn
// pixel by pixel.
"use strict";
if (!self.document) {
  const EVERY = { undefined: true }; // strokes in cells have no layers
  const cells = new Map(); // name -> strokes, in pixels of the picture from the corner of the cell

  // Compute the drawn width and opacity of a stroke as `soft_edge` of the SVG exporter does.
  const opacity = (strokes, k) => strokes.opacity[k] * (strokes.half[k] / (strokes.reach(k) || 1));

  function isIn(strokes, k, { left, top, right, bottom }) {
    const [x0, y0, x1, y1, x2, y2] = strokes.points.subarray(6 * k, 6 * k + 6);
    const wide = strokes.reach(k) * (1 + Math.abs(strokes.widening[k])) + strokes.soft + strokes.softness[k] / 2;
    return Math.max(x0, x1, x2) + wide > left && Math.min(x0, x1, x2) - wide < right
      && Math.max(y0, y1, y2) + wide > top && Math.min(y0, y1, y2) - wide < bottom;
  }

  function draw_shapes(pen, strokes, tile) {
    pen.setTransform(tile.zoom, 0, 0, tile.zoom, -tile.left * tile.zoom, -tile.top * tile.zoom);
    pen.lineCap = pen.lineJoin = "round";
    for (let k = 0; k < strokes.count; k++) {
      if (!strokes.half[k] || !isIn(strokes, k, tile)) continue;
      pen.globalAlpha = opacity(strokes, k);
      pen.fillStyle = pen.strokeStyle = strokes.color[k];
      strokes.trace(pen, k, strokes.reach(k));
    }
  }

  function draw_pixels(pen, strokes, tile) {
    const picture = pen.getImageData(0, 0, tile.width, tile.height);
    const points = strokes.points.map((value, i) => value - (i % 2 ? tile.top : tile.left));
    const lay = self.brushexp.brush({ ...strokes, points, soft: strokes.soft / Math.max(1, tile.zoom) });
    for (let k = 0; k < strokes.count; k++) if (isIn(strokes, k, tile)) lay(picture, k, tile.zoom);
    pen.putImageData(picture, 0, 0);
  }

  function draw(strokes, tile) {
    const canvas = new OffscreenCanvas(tile.width, tile.height);
    const pen = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
    pen.fillStyle = strokes.background;
    pen.fillRect(0, 0, tile.width, tile.height);
    (strokes.texture || strokes.isSmooth ? draw_pixels : draw_shapes)(pen, strokes, tile);
    return canvas.transferToImageBitmap();
  }

  function describe(strokes, { x, y, least }) {
    const k = strokes.at(x, y, strokes.count, EVERY, least);
    if (k < 0) return null;
    return { color: strokes.color[k], width: 2 * strokes.half[k], opacity: strokes.opacity[k] };
  }

  const tasks = {
    keep: ({ name, packed }) => { cells.set(name, packed); },
    forget: ({ name }) => { cells.delete(name); },
    draw: ({ name, tile }) => draw(cell(name), tile),
    describe: ({ name, place }) => describe(cell(name), place),
  };

  // Unpack strokes when they are first drawn.
  function cell(name) {
    const known = cells.get(name);
    if (!("data" in known)) return known;
    const strokes = self.brushexp.strokes({ ...known, texture: cells.get("textures") ?? null });
    const isSmooth = strokes.softness.some(Boolean) || strokes.drift.some(Boolean);
    cells.set(name, Object.assign(strokes, { layer: new Array(strokes.count), isSmooth }));
    return strokes;
  }

  onmessage = ({ data: { id, task, ...rest } }) => {
    const result = tasks[task](rest);
    if (id !== undefined) postMessage({ id, result }, result instanceof ImageBitmap ? [result] : []);
  };
}
