// The painting as an object: its relief under a lamp that can be moved, on a canvas. The formula is that of
// brushexp/relief/light.py, looked up in tables where it has powers.
"use strict";
{
  const DIRECT = 0.7, GAMMA = 2.2; // as there
  const SLOPES = 512, BRIGHTEST = 4; // entries of the table of k, and where it ends
  const stage = document.querySelector("#light-stage");
  const { source, top } = JSON.parse(document.querySelector("#heights").textContent);
  const canvas = stage.querySelector("canvas");
  const lamp = stage.querySelector(".lamp");
  const inputs = Object.fromEntries(["azimuth", "elevation", "depth", "gloss"].map((name) => [name, document.querySelector(`#${name}`)]));
  let map = null; // heights and colours, once they are decoded
  let waiting = false;

  // lit[k][c]: a colour c of 255 under light k / SLOPES * BRIGHTEST, before the highlights
  const lit = new Float32Array((SLOPES + 1) * 256);
  for (let i = 0; i <= SLOPES; i++) {
    const k = (i / SLOPES) * BRIGHTEST;
    for (let c = 0; c < 256; c++) lit[256 * i + c] = k <= 1 ? (c / 255) * k : 1 - (1 - c / 255) ** k;
  }

  async function pixelsOf(image, width, height) {
    await image.decode();
    const pen = Object.assign(document.createElement("canvas"), { width: width ?? image.naturalWidth, height: height ?? image.naturalHeight })
      .getContext("2d", { willReadFrequently: true });
    pen.drawImage(image, 0, 0, pen.canvas.width, pen.canvas.height);
    return pen.getImageData(0, 0, pen.canvas.width, pen.canvas.height);
  }

  async function load() {
    const heights = await pixelsOf(Object.assign(new Image(), { src: source }));
    const { width, height } = heights;
    const colors = await pixelsOf(document.querySelector("#painting"), width, height);
    const values = new Float32Array(width * height); // pixels of this map: red and green are 16 bits
    for (let i = 0; i < values.length; i++) values[i] = ((256 * heights.data[4 * i] + heights.data[4 * i + 1]) / 65535) * top;
    const [gx, gy] = [new Float32Array(values.length), new Float32Array(values.length)];
    for (let y = 0, i = 0; y < height; y++) {
      const [up, down] = [y ? -width : 0, y < height - 1 ? width : 0];
      for (let x = 0; x < width; x++, i++) {
        gx[i] = 0.5 * (values[i + (x < width - 1)] - values[i - (x > 0)]);
        gy[i] = 0.5 * (values[i + down] - values[i + up]);
      }
    }
    [canvas.width, canvas.height] = [width, height];
    map = { gx, gy, colors: colors.data, picture: new ImageData(width, height) };
    shade();
  }

  function shade() {
    waiting = false;
    if (!map) return;
    const { azimuth, elevation, depth, gloss } = Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, Number(input.value)]));
    const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
    const [lx, ly, lz] = [Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e)];
    const long = Math.hypot(lx, ly, lz + 1);
    const [mx, my, mz] = [lx / long, ly / long, (lz + 1) / long];
    const power = (x) => { const x8 = ((x * x) ** 2) ** 2; return x8 * x8 * x8; }; // of 24
    const flat = power(mz);
    const { gx, gy, colors, picture } = map;
    const out = picture.data;
    const ends = 2 ** 12; // the table of d^(1 / gamma)
    const roots = Float32Array.from({ length: ends + 1 }, (_, i) => Math.min(SLOPES, (SLOPES / BRIGHTEST) * ((i / ends) * 16) ** (1 / GAMMA)));
    for (let i = 0, j = 0; i < gx.length; i++, j += 4) {
      const x = depth * gx[i], y = depth * gy[i];
      const n = 1 / Math.sqrt(x * x + y * y + 1);
      const diffuse = 1 + DIRECT * (Math.max(n * (lz - x * lx + y * ly), 0) / lz - 1);
      const row = 256 * Math.round(roots[Math.min(ends, (diffuse * ends / 16) | 0)]);
      const shine = gloss * Math.max(power(Math.max(n * (mz - x * mx + y * my), 0)) - flat, 0);
      for (let c = 0; c < 3; c++) {
        const value = lit[row + colors[j + c]];
        out[j + c] = 255 * (value + shine * (1 - value));
      }
      out[j + 3] = 255;
    }
    canvas.getContext("2d").putImageData(picture, 0, 0);
    stage.dataset.ready = "yes";
  }

  function show() {
    for (const [name, input] of Object.entries(inputs)) {
      const [low, high] = [Number(input.min), Number(input.max)];
      input.style.setProperty("--at", `${(100 * (input.value - low)) / (high - low)}%`);
      document.querySelector(`output[for=${name}]`).textContent = name === "azimuth" || name === "elevation" ? `${Math.round(input.value)}°` : `${Number(input.value).toFixed(1)}`;
    }
    const a = (inputs.azimuth.value * Math.PI) / 180;
    const away = 46 * (1 - inputs.elevation.value / 90);
    lamp.style.left = `${50 + away * Math.sin(a)}%`;
    lamp.style.top = `${50 - away * Math.cos(a)}%`;
    if (!waiting) requestAnimationFrame(shade);
    waiting = true;
  }

  // A place in the picture is a place of the lamp: over its middle in the middle, low above the canvas at its rim.
  function follow(event) {
    const box = stage.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1;
    const y = 1 - (2 * (event.clientY - box.top)) / box.height;
    inputs.azimuth.value = ((Math.atan2(x, y) * 180) / Math.PI + 360) % 360;
    inputs.elevation.value = 90 * (1 - Math.min(1, Math.hypot(x, y) / 0.92));
    show();
  }

  stage.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    event.preventDefault();
    stage.setPointerCapture(event.pointerId);
    follow(event);
  });
  stage.addEventListener("pointermove", (event) => { if (stage.hasPointerCapture(event.pointerId)) follow(event); });
  for (const input of Object.values(inputs)) input.addEventListener("input", show);
  show();
  new IntersectionObserver((entries, observer) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    load();
  }, { rootMargin: "300px" }).observe(stage);
}
