// Provide OpenSeadragon with levels finer than the picture's, which a worker draws from the strokes. Each script beside
// the page holds the strokes of one square cell, and is loaded when a tile of that cell comes into view.
"use strict";
{
  const DEEPER = 5; // levels, each twice as large as the one before
  const SIDE = 512; // pixels of a tile
  const KEPT = 32; // cells in memory

  const brushexp = (window.brushexp ??= {});

  function start_worker() {
    const scripts = [...document.querySelectorAll("#worker script")].map((script) => script.textContent);
    const worker = new Worker(URL.createObjectURL(new Blob(["self.window = self;", ...scripts], { type: "text/javascript" })));
    const waiting = new Map(); // number of a request -> callback that receives the answer
    let asked = 0;
    worker.onmessage = ({ data: { id, result } }) => {
      waiting.get(id)(result);
      waiting.delete(id);
    };
    return {
      tell: (message) => worker.postMessage(message),
      ask: (message) => new Promise((done) => {
        waiting.set(++asked, done);
        worker.postMessage({ id: asked, ...message });
      }),
    };
  }

  brushexp.stroke_tiles = ({ width, height, strokes: { folder, cell: side, textured } }) => {
    const worker = start_worker();
    const cells = new Map(); // name -> promise that the worker has the cell; the most recently used is last
    const wanted = []; // tiles to draw, the newest last
    const base = Math.ceil(Math.log2(Math.max(width, height))); // level of the picture itself
    const [columns, rows] = [Math.ceil(width / side), Math.ceil(height / side)];
    let drawing = false;
    let textures = null; // promise that the worker has the textures

    brushexp.cell = (name, packed) => worker.tell({ task: "keep", name, packed });

    const script = (name) => new Promise((done, fail) => {
      const element = Object.assign(document.createElement("script"), { src: `${folder}/${name}.js`, onload: done });
      element.onerror = () => fail(new Error(`${element.src} is missing; move the page with its folders`));
      document.head.append(element);
    });
    const load = async (name) => {
      if (textured) await (textures ??= script("textures"));
      await script(name);
    };

    function loaded(name) {
      const known = cells.get(name) ?? load(name);
      cells.delete(name);
      cells.set(name, known);
      if (cells.size > KEPT) {
        const [oldest] = cells.keys();
        cells.delete(oldest);
        worker.tell({ task: "forget", name: oldest });
      }
      return known;
    }

    // The cell of a place, in pixels of the picture, and the place relative to the cell's corner.
    function place_of(x, y) {
      const [column, row] = [Math.floor(x / side), Math.floor(y / side)];
      const isInside = column >= 0 && row >= 0 && column < columns && row < rows;
      return { name: isInside ? `${column}_${row}` : null, left: x - column * side, top: y - row * side };
    }

    async function draw({ tile: { level, x, y } }) {
      const zoom = 2 ** (level - base);
      const { name, left, top } = place_of((x * SIDE) / zoom, (y * SIDE) / zoom);
      const size = { width: Math.min(SIDE, width * zoom - x * SIDE), height: Math.min(SIDE, height * zoom - y * SIDE) };
      const tile = { left, top, right: left + size.width / zoom, bottom: top + size.height / zoom, zoom, ...size };
      await loaded(name);
      return worker.ask({ task: "draw", name, tile });
    }

    async function draw_all() {
      if (drawing) return;
      drawing = true;
      while (wanted.length) {
        const job = wanted.pop();
        await draw(job).then((bitmap) => job.finish(bitmap, null, "imageBitmap"), (error) => job.fail(error.message, null));
      }
      drawing = false;
    }

    return {
      width: width * 2 ** DEEPER,
      height: height * 2 ** DEEPER,
      tileSize: SIDE,
      tileExists: (level, x, y) => { // the picture's own levels have no stroke tiles
        const part = SIDE / 2 ** (level - base);
        return level > base && x >= 0 && y >= 0 && x * part < width && y * part < height;
      },
      getTileUrl: (level, x, y) => `strokes:${level}/${x}_${y}`,
      downloadTileStart: (job) => {
        wanted.push(job);
        draw_all();
      },
      downloadTileAbort: (job) => {
        const at = wanted.indexOf(job);
        if (at >= 0) wanted.splice(at, 1);
      },
      // The uppermost stroke at a place, in pixels of the picture, or null if its cell is not loaded.
      describe: async (x, y, least) => {
        const { name, left, top } = place_of(x, y);
        return cells.has(name) ? cells.get(name).then(() => worker.ask({ task: "describe", name, place: { x: left, y: top, least } })) : null;
      },
      deeper: 2 ** DEEPER,
      finest: textured ? 1 : 0.5, // least screen pixels per tile pixel: textures are slow, and not crisp
    };
  };
}
