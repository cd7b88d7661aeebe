// The charts of a sweep: settings as points, and the quality of runs over time. They are independent of the table.
// brushexp.sweepCharts(data, pointed) returns draw(rows, x, y, picture): `rows` are the numbers of the shown runs, and
// pointed(group, rows, isFirst) is called when the pointer is on a setting. Means and the front depend on the filters
// and the chosen axes, so they are computed here and not taken from the tables.
"use strict";
{
  const { byId, chart } = window.brushexp;
  const { LETTER, node, points: path, plain, cut, mean, extent, isWide, linear, bands, scale, canvas, axes } = chart;
  const LONGEST = 40; // letters of a label
  const SERIES = 10; // curves that can be told apart: five colours, two dashes

  // Which points are on the Pareto front: no other is at least as cheap and as good, and better in one of the two.
  const front = (points, sign) =>
    points.filter((p) => !points.some((q) => q.x <= p.x && sign * q.y >= sign * p.y && (q.x < p.x || q.y !== p.y)));

  window.brushexp.sweepCharts = (data, pointed) => {
    const [pointsBox, curvesBox] = [byId("points"), byId("curves")];
    let drawn = null; // rows, x and y of the last drawing, its points, and their front
    let current = null; // group under the pointer
    let pinned = false; // whether it stays when the pointer leaves

    // Values along an axis: a metric, or a setting such as "axis:steps", whose values may be numbers or words.
    const variable = (key) => {
      const metric = data.metrics.find((one) => one.key === key);
      if (metric) return { ...metric, of: (row) => row.numbers[key] };
      const k = data.axes.findIndex((one) => `axis:${one.key}` === key);
      const { key: name, values, shown } = data.axes[k];
      const isNumeric = values.every((value) => value.trim() !== "" && Number.isFinite(Number(value)));
      const of = (row) => (isNumeric ? Number(values[row.chosen[k]]) : row.chosen[k]);
      return { name, of, isSetting: true, words: isNumeric ? null : shown, told: (row) => shown[row.chosen[k]] };
    };

    // The shown runs by their setting: means over seeds.
    const pointsOf = ({ rows, x, y }) => {
      const known = rows.filter((k) => [x, y].every((one) => Number.isFinite(one.of(data.rows[k]))));
      return [...Map.groupBy(known, (k) => data.rows[k].group)]
        .map(([group, of]) => {
          const [a, b] = [x, y].map((one) => mean(of.map((k) => one.of(data.rows[k]))));
          return { group, rows: of, x: a, y: b, label: data.groups[group].label };
        })
        .sort((p, q) => p.x - q.x || p.y - q.y);
    };

    const areaOf = (box) => {
      const width = Math.max(240, box.clientWidth);
      return canvas(box, width, Math.round(Math.min(400, Math.max(280, width * 0.68))));
    };

    // Labels on the empty side of the front, starting at the best point, wherever there is room.
    const label = (area, first, sign) => {
      let last = Infinity;
      for (const p of first.toReversed()) {
        const text = cut(p.label, LONGEST);
        const isRight = text.length * LETTER > p.left - area.left;
        const y = p.above + (isRight === (sign > 0) ? 18 : -9);
        if (Math.abs(y - last) < 15) continue;
        const place = isRight ? { x: p.left + 9, y } : { x: p.left - 9, y, "text-anchor": "end" };
        node(area.svg, "text", { class: "label", "aria-hidden": "true", ...place }, text);
        last = y;
      }
    };

    // Draw the line through the front, and return its points.
    const drawFront = (area, points, { x, y }) => {
      const isCost = !x.isSetting && x.better !== "higher" && x.key !== y.key;
      const sign = y.better === "higher" ? 1 : -1;
      const first = isCost && y.better ? front(points, sign) : [];
      if (first.length) {
        const steps = first.slice(1).map((p) => `H${p.left}V${p.above}`).join("");
        node(area.svg, "path", { class: "front", d: `M${first[0].left} ${first[0].above}${steps}H${area.right}` });
        label(area, first, sign);
      }
      const better = y.better && (sign > 0 ? "Higher is better." : "Lower is better.");
      const line = first.length ? "On the line: no other setting is both as cheap and as good." : "";
      byId("points-say").textContent = `${line} ${better}`;
      return first;
    };

    const drawPoints = () => {
      const { x, y } = drawn;
      const points = pointsOf(drawn);
      const area = areaOf(pointsBox);
      drawn.points = points;
      byId("points-say").textContent = "";
      if (!points.length) return node(area.svg, "text", { x: area.left, y: area.top }, "nothing to plot");
      const [scaleOf, values] = x.words ? [bands, x.words] : [scale, extent(points.map((p) => p.x))];
      const across = scaleOf(values, area.left, area.right);
      const up = scale(extent(points.map((p) => p.y)), area.floor, area.top);
      axes(area, across, up, [x.name, y.name]);
      for (const p of points) Object.assign(p, { left: across.place(p.x), above: up.place(p.y) });
      const first = drawFront(area, points, drawn);
      drawn.front = new Set(first.map((p) => p.group));
      for (const p of points) {
        const on = first.includes(p) || (!first.length && x.isSetting);
        const value = x.told?.(data.rows[p.rows[0]]) ?? plain(p.x);
        const runs = p.rows.length > 1 ? `, mean of ${p.rows.length} runs` : "";
        const ends = first.includes(p) ? `${runs}, on the front` : runs;
        const option = node(area.svg, "g", {
          class: `point${on ? " on" : ""}`, role: "option", tabindex: -1, "data-group": p.group,
          "aria-label": `${p.label}: ${y.name} ${plain(p.y)}, ${x.name} ${value}${ends}`,
        });
        node(option, "title", {}, p.label);
        node(option, "circle", { class: "reach", cx: p.left, cy: p.above, r: 13 });
        node(option, "circle", { class: "dot", cx: p.left, cy: p.above, r: on ? 6 : 4.5 });
      }
      if (!points.some((p) => p.group === current)) {
        current = (first.at(-1) ?? points.at(-1)).group;
        pinned = false;
      }
    };

    const drawCurves = () => {
      const rows = drawn.rows.map((k) => data.rows[k]).filter((row) => row.curve.length);
      const area = areaOf(curvesBox);
      byId("legend").replaceChildren();
      byId("curves-say").textContent = "";
      if (!rows.length) return node(area.svg, "text", { x: area.left, y: area.top }, "nothing to plot");
      const ends = extent(rows.map((row) => row.curve.at(-1)[0]));
      const seconds = rows.flatMap((row) => row.curve.map(([time]) => time)).filter((time) => time > 0);
      const start = isWide(ends) ? Math.max(extent(seconds)[0], ends[1] / 1e4) : 0; // a logarithmic scale has no 0
      const across = (start ? scale : linear)([start, ends[1]], area.left, area.right);
      const up = linear(extent(rows.flatMap((row) => row.curve.map(([, psnr]) => psnr))), area.floor, area.top);
      axes(area, across, up, ["optimisation, s", "PSNR, dB"]);
      const groups = [...new Set(rows.map((row) => row.group))];
      const leaders = groups.filter((group) => data.groups[group].ahead_from !== null)
        .sort((a, b) => data.groups[a].ahead_from - data.groups[b].ahead_from);
      const coloured = groups.length > SERIES ? leaders.slice(-SERIES) : groups;
      const rank = (row) => coloured.indexOf(row.group);
      const paint = (one, k, group) => {
        one.classList.add("curve", k < 0 ? "other" : k < 5 ? "solid" : "dashed");
        one.style.setProperty("--series", `var(--series-${1 + (k % 5)})`);
        one.dataset.group = group;
      };
      for (const row of rows.toSorted((p, q) => rank(p) - rank(q))) {
        const seen = row.curve.filter(([time]) => time >= start);
        const line = path(seen.map(([time, psnr]) => [across.place(time), up.place(psnr)]));
        const curve = node(area.svg, "g");
        paint(curve, rank(row), row.group);
        for (const name of ["line", "reach"]) node(curve, "polyline", { class: name, points: line });
      }
      for (const [k, group] of coloured.entries()) {
        const item = document.createElement("li");
        item.textContent = cut(data.groups[group].label, 60);
        paint(item, k, group);
        byId("legend").append(item);
      }
      if (coloured.length < groups.length) byId("curves-say").textContent = "In colour: settings that were ahead at some time.";
    };

    // Highlight a setting in both charts, and show its details.
    const tell = (group) => {
      current = group;
      for (const one of document.querySelectorAll("#points [data-group], #curves [data-group], #legend [data-group]")) {
        const is = one.dataset.group === String(group);
        if (is && one.matches("g.curve:not(.hot)")) one.parentNode.append(one); // on top of the others
        one.classList.toggle("hot", is);
        if (!one.matches(".point")) continue;
        one.setAttribute("aria-selected", is);
        one.setAttribute("tabindex", is ? 0 : -1);
      }
      const rows = drawn.rows.filter((k) => data.rows[k].group === group);
      if (rows.length) pointed(group, rows, drawn.front.has(group));
    };

    // Listen to events of the elements of a setting.
    const listen = (box, type, react) => box?.addEventListener(type, (event) => {
      const found = event.target.closest?.("[data-group]");
      react(found ? Number(found.dataset.group) : null);
    });
    for (const box of [pointsBox, curvesBox]) {
      listen(box, "pointerover", (group) => {
        if (group !== null && group !== current && !pinned) tell(group);
      });
      listen(box, "click", (group) => {
        pinned = group !== null;
        if (pinned) tell(group);
      });
    }
    listen(pointsBox, "focusin", (group) => {
      if (group === null || (pinned && group === current)) return;
      pinned = true;
      tell(group);
    });
    pointsBox?.addEventListener("keydown", (event) => {
      const order = drawn.points.map((p) => p.group);
      const [at, last] = [order.indexOf(current), order.length - 1];
      const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1, Home: -last, End: last }[event.key];
      if (event.key === "Escape") pinned = false;
      if (by === undefined) return;
      event.preventDefault();
      const group = order[Math.min(Math.max(at + by, 0), last)];
      pointsBox.querySelector(`[data-group="${group}"]`)?.focus();
    });

    const draw = () => {
      if (!drawn) return;
      if (pointsBox) drawPoints();
      if (curvesBox) drawCurves();
      tell(current);
    };
    addEventListener("resize", draw);

    return (shown, x, y, picture) => {
      const rows = shown.filter((k) => data.groups[data.rows[k].group]?.picture === picture);
      drawn = { rows, front: new Set(), x: x && variable(x), y: y && variable(y) };
      draw();
    };
  };
}
