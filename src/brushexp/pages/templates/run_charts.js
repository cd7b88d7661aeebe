// The charts of a run's page, from the numbers of drawings.py: <div data-chart='{"kind": "line", ...}'>. Until they are
// drawn, or without scripts, a sentence takes their place. brushexp.draw redraws them on pages whose numbers change.
"use strict";
{
  const { node, points, plain, extent, isWide, linear, scale, canvas, axes } = window.brushexp.chart;
  const [WIDTH, HEIGHT, RADIUS] = [420, 260, 100]; // units; about one pixel each

  const line = (box, { x, y, x_label, unit }) => {
    const area = canvas(box, WIDTH, HEIGHT);
    const across = linear([Math.min(0, x[0]), x.at(-1)], area.left, area.right, 0);
    const log = !unit && isWide(extent(y));
    const up = (log ? scale : linear)(extent(y), area.floor, area.top);
    axes(area, across, up, [x_label, log ? "logarithmic" : ""]);
    const places = x.map((value, k) => [across.place(value), up.place(y[k])]);
    node(area.svg, "polyline", { class: "line", points: points(places) });
  };

  const histogram = (box, { counts, end, largest, median, x_label }) => {
    const area = canvas(box, WIDTH, HEIGHT);
    const across = linear([0, end], area.left, area.right, 0);
    const up = linear([0, Math.max(...counts)], area.floor, area.top);
    up.ticks = up.ticks.filter(([count]) => Number.isInteger(count));
    const more = largest > end ? `; the last bar extends to ${plain(Number(largest.toFixed(1)))}` : "";
    axes(area, across, up, [x_label + more, "strokes"]);
    const edge = (k) => (k * end) / counts.length;
    for (const [k, count] of counts.entries()) {
      const [x, y, right] = [across.place(edge(k)), up.place(count), across.place(edge(k + 1))];
      const size = { x: x + 0.7, y, width: right - x - 1.4, height: area.floor - y };
      const bar = node(area.svg, "rect", { class: "bin", rx: 1, ...size });
      const [from, to] = [edge(k), edge(k + 1)].map((value) => plain(Number(value.toFixed(2))));
      node(bar, "title", {}, `${from} to ${to}: ${count.toLocaleString("en")} strokes`);
    }
    const x = across.place(median);
    const side = x > WIDTH / 2 ? { x: x - 6, "text-anchor": "end" } : { x: x + 6 };
    node(area.svg, "path", { class: "mark", d: `M${x} ${area.top}V${area.floor}` });
    const text = `median ${plain(Number(median.toPrecision(3)))}`;
    node(area.svg, "text", { class: "label", y: area.top + 10, ...side }, text);
  };

  // Areas of sectors are proportional to their shares; a direction appears on both sides.
  const rose = (box, { shares }) => {
    const { svg } = canvas(box, 300, 260);
    svg.setAttribute("viewBox", "-150 -130 300 260");
    svg.classList.add("rose");
    const grid = node(svg, "g", { class: "axes" });
    for (const r of [RADIUS, RADIUS * Math.SQRT1_2]) node(grid, "circle", { r });
    node(grid, "path", { d: `M${-RADIUS} 0H${RADIUS}M0 ${-RADIUS}V${RADIUS}` });
    for (const [angle, label] of [[0, "0°"], [45, "45°"], [90, "90°"]]) {
      const [x, y] = [Math.cos, Math.sin].map((f) => (RADIUS + 18) * f((angle * Math.PI) / 180));
      node(grid, "text", { x, y: y + 4, "text-anchor": "middle" }, label);
    }
    const step = Math.PI / shares.length;
    for (const [k, share] of [...shares, ...shares].entries()) {
      const reach = RADIUS * Math.sqrt(share / Math.max(...shares));
      const rim = [-0.47, 0.47].map((side) => (k + side) * step).map((angle) => [Math.cos(angle), Math.sin(angle)]);
      const [from, to] = rim.map((way) => way.map((part) => (reach * part).toFixed(1)));
      const sector = node(svg, "path", { class: "bin", d: `M0 0L${from}A${reach} ${reach} 0 0 1 ${to}Z` });
      const angle = Math.round(((k % shares.length) * 180) / shares.length);
      node(sector, "title", {}, `${angle}°: ${(100 * share).toFixed(1)}%`);
    }
  };

  const draw = (window.brushexp.draw = { line, histogram, rose });
  for (const box of document.querySelectorAll("[data-chart]")) {
    const chart = JSON.parse(box.dataset.chart);
    draw[chart.kind](box, chart);
  }
}
