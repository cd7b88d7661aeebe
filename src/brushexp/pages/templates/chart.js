// Charts as SVG in the colours of the page: elements, numbers, scales with their ticks, and axes. brushexp.chart has
// them for run_charts.js and sweep_charts.js.
"use strict";
{
  const brushexp = (window.brushexp ??= {});
  const LETTER = 7; // pixels: approximate width of a letter
  const MARGIN = { left: 50, right: 16, top: 26, bottom: 44 }; // pixels around the plot
  const LOG_RATIO = 20; // ratio of the largest to the smallest number above which a scale is logarithmic
  const MOST_TICKS = 9; // of a logarithmic scale
  const SPACING = { across: 70, up: 45 }; // least distance between two ticks, in pixels

  const node = (parent, name, attributes = {}, text) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  };
  const points = (pairs) => pairs.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");

  const plain = (number) => {
    const size = Math.abs(number);
    if (size && (size < 1e-3 || size >= 1e6)) return Number(number.toPrecision(3)).toExponential().replace("e+", "e");
    return Number(number.toPrecision(6)).toLocaleString("en", { maximumFractionDigits: 6 });
  };
  const cut = (text, most) => (text.length > most ? `${text.slice(0, Math.max(1, most - 1))}…` : text);
  const mean = (numbers) => numbers.reduce((sum, number) => sum + number, 0) / numbers.length;
  const extent = (numbers) => [numbers.reduce((a, b) => Math.min(a, b)), numbers.reduce((a, b) => Math.max(a, b))];
  const isWide = ([low, high]) => low > 0 && high / low > LOG_RATIO;

  // A scale maps values to pixels and has ticks, pairs of value and text. On vertical scales `from` exceeds `to`.
  const linear = ([low, high], from, to, margin = 0.06) => {
    const room = high > low ? margin * (high - low) : 0.1 * Math.abs(low) || 1;
    const bottom = low >= 0 ? Math.max(0, low - room) : low - room;
    const span = high + room - bottom;
    const count = Math.max(2, Math.abs(to - from) / (from < to ? SPACING.across : SPACING.up));
    const power = 10 ** Math.floor(Math.log10(span / count));
    const step = [1, 2, 5, 10].map((k) => k * power).find((size) => span / size <= count);
    const ticks = [];
    const last = (bottom + span) / step + 1e-9;
    for (let k = Math.ceil(bottom / step); k <= last; k++) ticks.push([k * step, plain(k * step)]);
    return { place: (value) => from + ((value - bottom) / span) * (to - from), ticks };
  };
  const logarithmic = ([low, high], from, to) => {
    const [first, last] = [low / 1.3, high * 1.3];
    const [start, end] = [first, last].map((value) => Math.floor(Math.log10(value)));
    const factors = end - start > 2 ? [1] : [1, 2, 5];
    const ticks = [];
    for (let decade = start; decade <= end; decade++)
      ticks.push(...factors.map((factor) => factor * 10 ** decade).filter((tick) => tick >= first && tick <= last));
    const every = Math.ceil(ticks.length / MOST_TICKS);
    const place = (value) => from + (Math.log(value / first) / Math.log(last / first)) * (to - from);
    return { place, ticks: ticks.filter((_, k) => k % every === 0).map((tick) => [tick, plain(tick)]) };
  };
  const bands = (names, from, to) => {
    const width = (to - from) / names.length;
    const every = Math.ceil(40 / width); // as many names as stay legible
    const most = Math.floor((width * every) / LETTER) - 1;
    const ticks = names.map((name, k) => [k, cut(name, most)]).filter((_, k) => k % every === 0);
    return { place: (value) => from + (value + 0.5) * width, ticks };
  };
  const scale = (range, from, to) => (isWide(range) ? logarithmic : linear)(range, from, to);

  // An empty drawing in a box: its size, and the edges of the plot.
  const canvas = (box, width, height) => {
    box.replaceChildren();
    const svg = node(box, "svg", { viewBox: `0 0 ${width} ${height}`, role: "none" });
    const { left, top, right, bottom } = MARGIN;
    return { svg, width, height, left, top, right: width - right, floor: height - bottom };
  };
  const axes = ({ svg, width, left, right, top, floor, height }, across, up, names) => {
    const group = node(svg, "g", { class: "axes", "aria-hidden": "true" });
    for (const [value, text] of up.ticks) {
      const y = up.place(value);
      node(group, "path", { d: `M${left} ${y}H${right}` });
      node(group, "text", { x: left - 8, y: y + 4, "text-anchor": "end" }, text);
    }
    for (const [value, text] of across.ticks) {
      const x = across.place(value);
      node(group, "path", { class: "across", d: `M${x} ${top}V${floor}` });
      node(group, "text", { x, y: floor + 18, "text-anchor": "middle" }, text);
    }
    node(group, "path", { class: "ground", d: `M${left} ${floor}H${right}` });
    node(group, "text", { class: "axis-name", x: right, y: height - 6, "text-anchor": "end" }, names[0]);
    node(group, "text", { class: "axis-name", x: 2, y: 12 }, cut(names[1], Math.floor(width / LETTER)));
  };

  brushexp.chart = { LETTER, node, points, plain, cut, mean, extent, isWide, linear, bands, scale, canvas, axes };
}
