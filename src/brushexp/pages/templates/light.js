// Show the painting's relief on a canvas under a movable lamp. Formula and constants are those of
// brushexp/shading/light.py.
"use strict";
{
  const DIRECT = 0.7, GAMMA = 2.2, SHININESS = 24;
  const { byId, drag } = window.brushexp;
  const stage = byId("light-stage");
  const canvas = stage.querySelector("canvas");
  const lamp = stage.querySelector(".lamp");
  const { source, top } = JSON.parse(byId("heights").textContent);
  const names = ["azimuth", "elevation", "depth", "gloss"];
  const settings = () => names.map((name) => Number(byId(name).value));
  const radians = (degrees) => (degrees * Math.PI) / 180;
  let map = null; // slopes and colours, once decoded
  let waiting = false;

  function pixelsOf(image, width, height) {
    const pen = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    pen.drawImage(image, 0, 0, width, height);
    return pen.getImageData(0, 0, width, height).data;
  }

  async function load() {
    const [heights, painting] = [Object.assign(new Image(), { src: source }), byId("flat")];
    await Promise.all([heights.decode(), painting.decode()]);
    const { naturalWidth: width, naturalHeight: height } = heights;
    const data = pixelsOf(heights, width, height);
    const heightAt = (x, y) => { // in this map red and green hold 16 bits; edges are extended
      const i = 4 * (Math.min(height - 1, Math.max(0, y)) * width + Math.min(width - 1, Math.max(0, x)));
      return ((256 * data[i] + data[i + 1]) / 65535) * top;
    };
    const [gx, gy] = [new Float32Array(width * height), new Float32Array(width * height)];
    for (let i = 0; i < gx.length; i++) {
      const [x, y] = [i % width, Math.floor(i / width)];
      gx[i] = 0.5 * (heightAt(x + 1, y) - heightAt(x - 1, y));
      gy[i] = 0.5 * (heightAt(x, y + 1) - heightAt(x, y - 1));
    }
    Object.assign(canvas, { width, height });
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
    const [mx, my, mz] = [lx / long, ly / long, (lz + 1) / long]; // halfway between lamp and eye
    const { gx, gy, colors, picture } = map;
    for (let i = 0, j = 0; i < gx.length; i++, j += 4) {
      const x = depth * gx[i], y = depth * gy[i];
      const n = 1 / Math.sqrt(x * x + y * y + 1);
      const light = (1 + DIRECT * (Math.max(n * (lz - x * lx + y * ly), 0) / lz - 1)) ** (1 / GAMMA);
      const shine = gloss * Math.max(Math.max(n * (mz - x * mx + y * my), 0) ** SHININESS - mz ** SHININESS, 0);
      for (let c = 0; c < 3; c++) {
        const color = colors[j + c] / 255;
        const lit = light <= 1 ? color * light : 1 - (1 - color) ** light;
        picture.data[j + c] = 255 * (lit + shine * (1 - lit));
      }
      picture.data[j + 3] = 255;
    }
    canvas.getContext("2d").putImageData(picture, 0, 0);
    stage.dataset.ready = "yes";
  }

  function show() {
    const [azimuth, elevation, depth, gloss] = settings();
    const texts = [`${Math.round(azimuth)}°`, `${Math.round(elevation)}°`, depth.toFixed(1), gloss.toFixed(2)];
    for (const [k, name] of names.entries()) document.querySelector(`output[for=${name}]`).textContent = texts[k];
    const away = 46 * (1 - elevation / 90);
    lamp.style.left = `${50 + away * Math.sin(radians(azimuth))}%`;
    lamp.style.top = `${50 - away * Math.cos(radians(azimuth))}%`;
    if (!waiting) requestAnimationFrame(shade);
    waiting = true;
  }

  // The pointer moves the lamp: overhead at the middle of the picture, low above the canvas at its edges.
  drag(stage, (across, down) => {
    const [x, y] = [2 * across - 1, 1 - 2 * down];
    byId("azimuth").value = ((Math.atan2(x, y) * 180) / Math.PI + 360) % 360;
    byId("elevation").value = 90 * (1 - Math.min(1, Math.hypot(x, y) / 0.92));
    show();
  });
  for (const name of names) byId(name).addEventListener("input", show);
  show();
  load();
}
