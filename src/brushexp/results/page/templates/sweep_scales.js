// Arithmetic of the plots of a sweep: scales with their ticks, numbers and names as they are written, what is on the
// front, and how good a run was at some time. brushexp.scales has it for sweep_plots.js.
"use strict";
{
  const brushexp = (window.brushexp ??= {});
  const LETTER = 7; // pixels: width of a letter, roughly
  const WIDE = 20; // largest over smallest number from which a scale is logarithmic
  const STEPS = [[1], [1, 3], [1, 2, 5], [1, 1.5, 2, 3, 5, 7]]; // ticks in a decade

  const plain = (number) => Number(number.toPrecision(6)).toLocaleString("en", { maximumFractionDigits: 6 });
  const cut = (text, most) => (text.length > most ? `${text.slice(0, Math.max(1, most - 1))}…` : text);
  const isWide = (numbers) => Math.min(...numbers) > 0 && Math.max(...numbers) / Math.min(...numbers) > WIDE;

  // A scale places values between two pixels and has ticks: pairs of value and text.
  const linear = (low, high, from, to) => {
    const room = high > low ? 0.06 * (high - low) : 0.1 * Math.abs(low) || 1;
    const bottom = low >= 0 ? Math.max(0, low - room) : low - room;
    const span = high + room - bottom;
    const count = Math.max(2, Math.abs(to - from) / 70);
    const power = 10 ** Math.floor(Math.log10(span / count));
    const step = [1, 2, 5, 10].map((k) => k * power).find((size) => span / size <= count);
    const ticks = [];
    for (let k = Math.ceil(bottom / step); k * step <= bottom + span; k++) ticks.push([k * step, plain(k * step)]);
    return { place: (value) => from + ((value - bottom) / span) * (to - from), ticks };
  };
  const logarithmic = (low, high, from, to) => {
    const [first, last] = [low / 1.3, high * 1.3];
    let ticks = [];
    for (const steps of STEPS) {
      const found = [];
      for (let decade = Math.floor(Math.log10(first)); decade <= Math.log10(last); decade++)
        found.push(...steps.map((step) => step * 10 ** decade).filter((tick) => tick >= first && tick <= last));
      if (ticks.length > 1 && found.length > Math.abs(to - from) / 44) break;
      ticks = found;
      if (ticks.length > 3) break;
    }
    const place = (value) => from + (Math.log(value / first) / Math.log(last / first)) * (to - from);
    return { place, ticks: ticks.map((tick) => [tick, plain(tick)]) };
  };
  const bands = (names, from, to) => {
    const width = (to - from) / names.length;
    const every = Math.ceil(40 / width); // as many names as can be read
    const most = Math.floor((width * every) / LETTER) - 1;
    const ticks = names.map((name, k) => [k, cut(name, most)]).filter((_, k) => k % every === 0);
    return { place: (value) => from + (value + 0.5) * width, ticks };
  };
  const scale = (numbers, from, to) =>
    (isWide(numbers) ? logarithmic : linear)(Math.min(...numbers), Math.max(...numbers), from, to);

  // Which pairs are on the Pareto front: no other is as low in cost and as good, and better in one.
  const front = (points, sign) =>
    points.filter((p) => !points.some((q) => q.x <= p.x && sign * q.y >= sign * p.y && (q.x < p.x || q.y !== p.y)));

  const at = (curve, time) => { // the best so far, between two points as on a line
    let best = -Infinity;
    for (let k = 0; k < curve.length && curve[k][0] <= time; k++) {
      best = Math.max(best, curve[k][1]);
      if (k + 1 < curve.length && curve[k + 1][0] > time) {
        const share = (time - curve[k][0]) / (curve[k + 1][0] - curve[k][0]);
        best = Math.max(best, curve[k][1] + share * (curve[k + 1][1] - curve[k][1]));
      }
    }
    return best;
  };

  brushexp.scales = { LETTER, plain, cut, isWide, linear, logarithmic, bands, scale, front, at };
}
