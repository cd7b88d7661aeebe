// The strokes in the page's data, their colours, and which of them are shown. brushexp.recovered provides them to the
// view and the exports; the document receives the event "shown" whenever the selection changes.
"use strict";
{
  const { byId, chart, draw } = window.brushexp;
  const data = JSON.parse(byId("data").textContent);
  const { columns, outlines, mm } = data;
  const count = outlines.length;
  const BINS = 28;
  const DIRECTIONS = 18; // sectors of 10 degrees
  const TAIL = 0.99; // quantile at which scales end
  const STOPS = ["#8f9cff", "#5cb8ff", "#45d6b5", "#a8e04f", "#ffe833"]; // bright, for lines with dark rims
  const units = { length: 1, width: 1, area: 2 }; // powers of pixels
  const threshold = byId("threshold");
  const colorBy = byId("color-by");

  const inUnit = (name, value) => (mm && units[name] ? value * mm ** units[name] : value);
  const unitOf = (name) => {
    if (units[name]) return (mm ? "mm" : "px") + (units[name] === 2 ? "²" : "");
    return name === "direction" || name === "curvature" ? "°" : "";
  };
  const sorted = (values) => Float64Array.from(values).sort();
  const quantile = (ordered, share) => ordered[Math.min(ordered.length - 1, Math.floor(share * ordered.length))] ?? 0;
  const isShown = (k) => columns.confidence[k] >= Number(threshold.value) && outlines[k].length > 0;

  const mix = (share) => {
    const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
    const k = Math.min(Math.floor(at), STOPS.length - 2);
    const part = (color, i) => parseInt(color.slice(1 + 2 * i, 3 + 2 * i), 16);
    const levels = [0, 1, 2].map((i) => Math.round(part(STOPS[k], i) + (at - k) * (part(STOPS[k + 1], i) - part(STOPS[k], i))));
    return `rgb(${levels.join(" ")})`;
  };
  const wheel = (degrees) => `hsl(${(2 * degrees + 30) % 360} 85% 60%)`;
  const ranges = { confidence: [0, 1], direction: [0, 180], order: [0, Math.max(count - 1, 1)] };
  for (const name of ["length", "width"]) ranges[name] = [0, quantile(sorted(columns[name]), TAIL) || 1];
  const colorAt = (name, value) => (name === "direction" ? wheel(value) : mix((value - ranges[name][0]) / (ranges[name][1] - ranges[name][0])));
  const colorOf = (k) => colorAt(colorBy.value, columns[colorBy.value][k]);

  const plain = (value, digits = 3) => chart.plain(Number(value.toPrecision(digits)));
  const legend = () => {
    const name = colorBy.value;
    const svg = byId("legend");
    svg.replaceChildren();
    const [low, high] = ranges[name];
    for (let k = 0; k < 60; k++)
      chart.node(svg, "rect", { x: 5 * k, y: 2, width: 5.3, height: 14, fill: colorAt(name, low + ((k + 0.5) / 60) * (high - low)) });
    const words = name === "order" ? ["bottom", "", "top"] : [low, (low + high) / 2, high].map((value) => plain(inUnit(name, value)) + unitOf(name));
    for (const [k, word] of words.entries())
      chart.node(svg, "text", { x: 150 * k, y: 33, "text-anchor": ["start", "middle", "end"][k] }, word);
  };

  const histogram = (shown) => {
    const name = byId("histogram-of").value;
    byId("histogram-name").textContent = name + (unitOf(name) ? `, ${unitOf(name)}` : "");
    const values = sorted(shown.map((k) => inUnit(name, columns[name][k])));
    byId("histogram").replaceChildren();
    if (!values.length) return;
    const largest = values.at(-1);
    const end = largest < 1.15 * quantile(values, TAIL) ? largest || 1 : quantile(values, TAIL) || 1;
    const counts = new Array(BINS).fill(0);
    for (const value of values) counts[Math.min(BINS - 1, Math.floor((value / end) * BINS))]++;
    draw.histogram(byId("histogram"), { counts, end, largest, median: quantile(values, 0.5), x_label: unitOf(name) });
  };
  const rose = (shown) => {
    const shares = new Array(DIRECTIONS).fill(0);
    for (const k of shown) shares[Math.floor((columns.direction[k] * DIRECTIONS) / 180 + 0.5) % DIRECTIONS] += columns.length[k];
    const total = shares.reduce((sum, share) => sum + share, 0);
    byId("rose").replaceChildren();
    if (total) draw.rose(byId("rose"), { shares: shares.map((share) => share / total) });
  };

  const shown = () => outlines.map((_, k) => k).filter(isShown);
  const update = () => {
    const now = shown();
    const middle = (name) => `${plain(inUnit(name, quantile(sorted(now.map((k) => columns[name][k])), 0.5)))} ${unitOf(name)}`;
    document.querySelector("output[for=threshold]").textContent = Number(threshold.value).toFixed(2);
    const medians = now.length ? `; medians: length ${middle("length")}, width ${middle("width")}` : "";
    byId("count").textContent = `${now.length.toLocaleString("en")} of ${count.toLocaleString("en")} recovered strokes have a confidence of ${Number(threshold.value).toFixed(2)} or more and are shown${medians}.`;
    legend();
    histogram(now);
    rose(now);
    document.dispatchEvent(new Event("shown"));
  };

  window.brushexp.recovered = { data, count, isShown, shown, colorOf, inUnit, unitOf, plain };
  for (const control of [threshold, colorBy, byId("histogram-of")]) control.addEventListener("input", update);
  addEventListener("load", update);
}
