// The painting as an object: its relief under a lamp that can be moved, on a canvas. The formula is that of
// brushexp/shading/light.py, looked up in tables where it has powers.
"use strict";
{
  const DIRECT = 0.7, GAMMA = 2.2; // as there
  const LEVELS = 512, BRIGHTEST = 4; // entries of the table of light, and where it ends
  const ROOTS = 4096, LARGEST = 16; // the same of the table of d^(1 / gamma)
  const { byId, drag, whenSeen } = window.brushexp;
  const stage = byId("light-stage");
  const canvas = stage.querySelector("canvas");
  const lamp = stage.querySelector(".lamp");
  const { source, top } = JSON.parse(byId("heights").textContent);
  const names = ["azimuth", "elevation", "depth", "gloss"];
  const settings = () => names.map((name) => Number(byId(name).value));
  const radians = (degrees) => (degrees * Math.PI) / 180;
  let map = null; // slopes and colours, once they are decoded
  let waiting = false;

  // lit[256 k + c]: a colour c of 255 under light k / LEVELS * BRIGHTEST, before the highlights
  const lit = Float32Array.from({ length: 256 * (LEVELS + 1) }, (_, i) => {
    const [light, color] = [(Math.floor(i / 256) / LEVELS) * BRIGHTEST, (i % 256) / 255];
    return light <= 1 ? color * light : 1 - (1 - color) ** light;
  });
  const roots = Float32Array.from({ length: ROOTS + 1 }, (_, i) =>
    Math.min(LEVELS, (LEVELS / BRIGHTEST) * ((i / ROOTS) * LARGEST) ** (1 / GAMMA)));

  function pixelsOf(image, width, height) {
    const sized = Object.assign(document.createElement("canvas"), { width, height });
    const pen = sized.getContext("2d", { willReadFrequently: true });
    pen.drawImage(image, 0, 0, width, height);
    return pen.getImageData(0, 0, width, height).data;
  }

  async function load() {
    const [heights, painting] = [Object.assign(new Image(), { src: source }), byId("painting")];
    await Promise.all([heights.decode(), painting.decode()]);
    const { naturalWidth: width, naturalHeight: height } = heights;
    const data = pixelsOf(heights, width, height);
    const heightAt = (x, y) => { // pixels of this map: red and green are 16 bits; beyond an edge it goes on as there
      const i = 4 * (Math.min(height - 1, Math.max(0, y)) * width + Math.min(width - 1, Math.max(0, x)));
      return ((256 * data[i] + data[i + 1]) / 65535) * top;
    };
    const [gx, gy] = [new Float32Array(width * height), new Float32Array(width * height)];
    for (let i = 0; i < gx.length; i++) {
      const [x, y] = [i % width, Math.floor(i / width)];
      gx[i] = 0.5 * (heightAt(x + 1, y) - heightAt(x - 1, y));
      gy[i] = 0.5 * (heightAt(x, y + 1) - heightAt(x, y - 1));
    }
    [canvas.width, canvas.height] = [width, height];
    map = { gx, gy, colors: pixelsOf(painting, width, height), picture: new ImageData(width, height) };
    shade();
  }

  function shade() {
    waiting = false;
    if (!map) return;
    const [azimuth, elevation, depth, gloss] = settings();
    const [a, e] = [radians(azimuth), radians(elevation)];
    const [lx, ly, lz] = [Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e)]; // towards the lamp
    const long = Math.hypot(lx, ly, lz + 1);
    const [mx, my, mz] = [lx / long, ly / long, (lz + 1) / long]; // half way between the lamp and the eye
    const power = (x) => { const x8 = ((x * x) ** 2) ** 2; return x8 * x8 * x8; }; // of 24
    const flat = power(mz);
    const { gx, gy, colors, picture } = map;
    const out = picture.data;
    for (let i = 0, j = 0; i < gx.length; i++, j += 4) {
      const x = depth * gx[i], y = depth * gy[i];
      const n = 1 / Math.sqrt(x * x + y * y + 1);
      const diffuse = 1 + DIRECT * (Math.max(n * (lz - x * lx + y * ly), 0) / lz - 1);
      const row = 256 * Math.round(roots[Math.min(ROOTS, (diffuse * ROOTS / LARGEST) | 0)]);
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
    const [azimuth, elevation, depth, gloss] = settings();
    const texts = [`${Math.round(azimuth)}°`, `${Math.round(elevation)}°`, depth.toFixed(1), gloss.toFixed(1)];
    for (const [k, name] of names.entries()) document.querySelector(`output[for=${name}]`).textContent = texts[k];
    const away = 46 * (1 - elevation / 90);
    lamp.style.left = `${50 + away * Math.sin(radians(azimuth))}%`;
    lamp.style.top = `${50 - away * Math.cos(radians(azimuth))}%`;
    if (!waiting) requestAnimationFrame(shade);
    waiting = true;
  }

  // A place in the picture is a place of the lamp: over its middle in the middle, low above the canvas at its rim.
  drag(stage, (across, down) => {
    const [x, y] = [2 * across - 1, 1 - 2 * down];
    byId("azimuth").value = ((Math.atan2(x, y) * 180) / Math.PI + 360) % 360;
    byId("elevation").value = 90 * (1 - Math.min(1, Math.hypot(x, y) / 0.92));
    show();
  });
  for (const name of names) byId(name).addEventListener("input", show);
  show();
  whenSeen(stage, load);
}
