// The plots of a sweep: settings as points, and the quality of runs on their way. They know nothing of the table.
// brushexp.plots(data, pointed) gives { draw(shown, x, y, picture), mark(group) }: `shown` are numbers of rows, and
// pointed(group, rows, front) is called when somebody points at a setting.
"use strict";
{
  const brushexp = (window.brushexp ??= {});
  const { LETTER, plain, cut, isWide, linear, logarithmic, bands, scale, front, at } = brushexp.scales;
  const SPACE = "http://www.w3.org/2000/svg";
  const MARGIN = { left: 50, right: 16, top: 26, bottom: 44 }; // pixels around what is plotted
  const LONGEST = 40; // letters of a label
  const SERIES = 10; // curves that can be told apart: five colours, two dashes
  const LEAD = 0.1; // dB: by so much a curve must be better than the one ahead to take its place
  const TIMES = 200; // at which it is asked which one is ahead

  const node = (parent, name, attributes = {}, text) => {
    const made = document.createElementNS(SPACE, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  };
  const mean = (numbers) => numbers.reduce((sum, number) => sum + number, 0) / numbers.length;

  brushexp.plots = (data, pointed) => {
    const charts = { points: document.getElementById("points"), curves: document.getElementById("curves") };
    const metric = (key) => data.metrics.find((one) => one.key === key);
    const axis = (key) => data.axes.find((one) => `axis:${one.key}` === key);
    const nameOf = (key) => axis(key)?.key ?? metric(key).name;
    const isNumeric = (one) => one.values.every((value) => value.trim() !== "" && Number.isFinite(Number(value)));
    let drawn = null; // what was drawn last
    let current = null; // group that is pointed at
    let pinned = false; // whether it stays when the pointer goes elsewhere
    let touched = false; // whether anybody has pointed yet

    const valueOf = (row, key) => {
      const along = axis(key);
      if (!along) return row.numbers[key];
      const chosen = row.chosen[data.axes.indexOf(along)];
      return isNumeric(along) ? Number(along.values[chosen]) : chosen;
    };

    // The shown runs by their setting: means over seeds.
    const pointsOf = ({ shown, x, y, picture }) => {
      const found = new Map();
      for (const k of shown) {
        const row = data.rows[k];
        if (row.group === null || data.groups[row.group].picture !== picture) continue;
        if (![x, y].every((key) => Number.isFinite(valueOf(row, key)))) continue;
        found.set(row.group, [...(found.get(row.group) ?? []), k]);
      }
      const middle = (rows, key) => mean(rows.map((k) => valueOf(data.rows[k], key)));
      return [...found]
        .map(([group, rows]) => ({ group, rows, x: middle(rows, x), y: middle(rows, y) }))
        .sort((p, q) => p.x - q.x || p.y - q.y);
    };

    const canvas = (chart) => {
      const width = Math.max(240, chart.clientWidth);
      const height = Math.round(Math.min(400, Math.max(280, width * 0.68)));
      chart.replaceChildren();
      const svg = node(chart, "svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "none" });
      return { svg, width, height, right: width - MARGIN.right, floor: height - MARGIN.bottom };
    };

    const empty = ({ svg, width, height }) =>
      node(svg, "text", { class: "axis-name", x: width / 2 - 45, y: height / 2 }, "nothing to plot");

    const axes = ({ svg, width, right, floor, height }, across, up, names) => {
      const group = node(svg, "g", { class: "axes", "aria-hidden": "true" });
      for (const [value, text] of up.ticks) {
        const y = up.place(value);
        node(group, "line", { x1: MARGIN.left, x2: right, y1: y, y2: y });
        node(group, "text", { x: MARGIN.left - 8, y: y + 4, "text-anchor": "end" }, text);
      }
      for (const [value, text] of across.ticks) {
        const x = across.place(value);
        node(group, "line", { x1: x, x2: x, y1: MARGIN.top, y2: floor });
        node(group, "text", { x, y: floor + 18, "text-anchor": "middle" }, text);
      }
      node(group, "text", { class: "axis-name", x: right, y: height - 6, "text-anchor": "end" }, names[0]);
      node(group, "text", { class: "axis-name", x: 2, y: 12 }, cut(names[1], Math.floor(width / LETTER)));
    };

    // Labels of the points of the front, where they cover neither each other nor a point.
    const label = (area, points, first) => {
      const taken = points.map((p) => [p.left - 7, p.above - 7, p.left + 7, p.above + 7]);
      for (let k = 0; k < first.length; k++) { // nor the line through the front
        const [p, next] = [first[k], first[k + 1]];
        taken.push([p.left, p.above - 2, next?.left ?? area.right, p.above + 2]);
        if (!next) continue;
        const [top, bottom] = [p.above, next.above].sort((a, b) => a - b);
        taken.push([next.left - 2, top, next.left + 2, bottom]);
      }
      for (const p of first) {
        const name = data.groups[p.group].label;
        const text = node(area.svg, "text", { class: "label", "aria-hidden": "true" }, cut(name, LONGEST));
        const width = text.getComputedTextLength();
        const [left, middle] = [-width - 10, -width / 2];
        const box = [[left, -8], [middle, -22], [10, 8], [left, 8], [middle, 14], [10, -20], [left, -22]]
          .map(([dx, dy]) => [p.left + dx, p.above + dy - 4, p.left + dx + width, p.above + dy + 11])
          .find(([x0, y0, x1, y1]) =>
            x0 >= MARGIN.left && x1 <= area.right && y0 >= MARGIN.top - 10 && y1 <= area.floor &&
            !taken.some((t) => x0 < t[2] && x1 > t[0] && y0 < t[3] && y1 > t[1]));
        if (!box) {
          text.remove();
          continue;
        }
        taken.push(box);
        if (text.textContent === name) drawn.labelled.add(p.group);
        text.setAttribute("x", box[0]);
        text.setAttribute("y", box[1] + 11);
      }
    };

    const told = (p, x, y) => {
      const along = axis(x);
      const across = along ? along.shown[data.rows[p.rows[0]].chosen[data.axes.indexOf(along)]] : plain(p.x);
      const runs = p.rows.length > 1 ? `, mean of ${p.rows.length} runs` : "";
      return `${nameOf(y)} ${plain(p.y)}, ${nameOf(x)} ${across}${runs}`;
    };

    const drawPoints = () => {
      if (!charts.points) return;
      const { x, y } = drawn;
      const focused = charts.points.contains(document.activeElement);
      const points = pointsOf(drawn);
      const area = canvas(charts.points);
      Object.assign(drawn, { points, front: new Set(), labelled: new Set() }); // labelled in full
      document.getElementById("points-say").textContent = "";
      if (!points.length) {
        empty(area);
        return;
      }
      const along = axis(x);
      const across =
        along && !isNumeric(along)
          ? bands(along.shown, MARGIN.left, area.right)
          : scale(points.map((p) => p.x), MARGIN.left, area.right);
      const up = scale(points.map((p) => p.y), area.floor, MARGIN.top);
      axes(area, across, up, [nameOf(x), nameOf(y)]);
      for (const p of points) Object.assign(p, { left: across.place(p.x), above: up.place(p.y) });
      const better = metric(y).better;
      const isCost = !along && metric(x).better !== "higher" && x !== y;
      const first = isCost && better ? front(points, better === "higher" ? 1 : -1) : [];
      drawn.front = new Set(first.map((p) => p.group));
      if (first.length) {
        const steps = first.slice(1).map((p) => `H${p.left}V${p.above}`).join("");
        node(area.svg, "path", { class: "front", d: `M${first[0].left} ${first[0].above}${steps}H${area.right}` });
        label(area, points, first);
      } else if (along) {
        const values = [...new Set(points.map((p) => p.x))];
        const middle = (value) => mean(points.filter((p) => p.x === value).map((p) => p.above));
        const line = values.map((value) => `${across.place(value)} ${middle(value)}`).join("L");
        node(area.svg, "path", { class: "front mean", d: `M${line}` });
      }
      const line = along ? "The line is the mean of the points. " : "";
      document.getElementById("points-say").textContent =
        (first.length ? "On the line: nothing else is as cheap and as good. " : line) +
        (better ? `${better[0].toUpperCase()}${better.slice(1)} is better.` : "");
      for (const p of points) {
        const on = first.includes(p) || (!first.length && Boolean(along));
        const option = node(area.svg, "g", {
          class: `point${on ? " on" : ""}`, role: "option", tabindex: -1, "data-group": p.group,
          "aria-label": `${data.groups[p.group].label}: ${told(p, x, y)}${first.includes(p) ? ", on the front" : ""}`,
          "aria-selected": "false",
        });
        node(option, "circle", { class: "reach", cx: p.left, cy: p.above, r: 13 });
        node(option, "circle", { class: "dot", cx: p.left, cy: p.above, r: on ? 6 : 4.5 });
      }
      node(area.svg, "g", { class: "hint", "aria-hidden": "true" });
      if (!points.some((p) => p.group === current)) {
        current = (first.at(-1) ?? points.at(-1)).group;
        pinned = false;
      }
      tell(current);
      if (focused) charts.points.querySelector(`[data-group="${current}"]`).focus();
    };

    // The runs that were ahead at some time, if there are more than can be told apart.
    const leaders = (rows) => {
      const groups = [...new Set(rows.map((row) => row.group))];
      if (groups.length <= SERIES) return groups;
      const ends = rows.map((row) => row.curve.at(-1)[0]);
      const [low, high] = [Math.max(Math.max(...ends) / 1e4, 1e-3), Math.max(...ends)];
      const found = [];
      let ahead = null;
      for (let k = 0; k <= TIMES; k++) {
        const time = low * (high / low) ** (k / TIMES);
        const now = rows.map((row) => at(row.curve, time));
        const best = now.indexOf(Math.max(...now));
        if (now[best] === -Infinity || (ahead !== null && now[best] <= now[ahead] + LEAD)) continue;
        ahead = best;
        found.push(rows[best].group);
      }
      return [...new Set(found)].slice(-SERIES);
    };

    const drawCurves = () => {
      if (!charts.curves) return;
      const { shown, picture } = drawn;
      const rows = shown
        .map((k) => data.rows[k])
        .filter((row) => row.curve.length && row.group !== null && data.groups[row.group].picture === picture);
      const legend = document.getElementById("legend");
      const area = canvas(charts.curves);
      legend.replaceChildren();
      document.getElementById("curves-say").textContent = "";
      if (!rows.length) {
        empty(area);
        return;
      }
      const ends = rows.map((row) => row.curve.at(-1)[0]);
      const log = isWide(ends);
      const seconds = rows.flatMap((row) => row.curve.map(([time]) => time)).filter((time) => time > 0);
      const start = Math.max(Math.min(...seconds), Math.max(...ends) / 1e4);
      const across = (log ? logarithmic : linear)(log ? start : 0, Math.max(...ends), MARGIN.left, area.right);
      const up = linear(...bounds(rows.flatMap((row) => row.curve.map(([, psnr]) => psnr))), area.floor, MARGIN.top);
      axes(area, across, up, ["optimisation, s", "PSNR, dB"]);
      const coloured = leaders(rows);
      const later = (row) => coloured.indexOf(row.group);
      for (const row of [...rows].sort((p, q) => later(p) - later(q))) {
        const seen = log ? row.curve.filter(([time]) => time >= start) : row.curve; // a logarithmic scale has no 0
        const places = seen.map(([time, psnr]) => `${across.place(time).toFixed(1)} ${up.place(psnr).toFixed(1)}`);
        const curve = node(area.svg, "g", { class: `curve ${look(later(row))}`, "data-group": row.group });
        node(curve, "path", { class: "line", d: `M${places.join("L")}` });
        node(curve, "path", { class: "reach", d: `M${places.join("L")}` });
      }
      for (const [k, group] of coloured.entries()) {
        const item = document.createElement("li");
        item.dataset.group = group;
        const swatch = node(item, "svg", { width: 24, height: 8, class: `curve ${look(k)}`, "aria-hidden": "true" });
        node(swatch, "path", { class: "line", d: "M1 4H23" });
        item.append(cut(data.groups[group].label, 60));
        legend.append(item);
      }
      if (rows.some((row) => !coloured.includes(row.group)))
        document.getElementById("curves-say").textContent = "In colour: what was ahead at some time.";
    };
    const bounds = (numbers) => [numbers.reduce((a, b) => Math.min(a, b)), numbers.reduce((a, b) => Math.max(a, b))];
    const look = (k) => (k < 0 ? "other" : `series-${1 + (k % 5)}${k >= 5 ? " dashed" : ""}`);

    // Light up a setting in both plots, with its name beside its point.
    const mark = (group) => {
      for (const one of document.querySelectorAll("#points [data-group], #curves [data-group], #legend [data-group]")) {
        const is = one.dataset.group === String(group);
        if (is && one.matches(".curve:not(.hot)")) one.parentNode.append(one); // above the others
        one.classList.toggle("hot", is);
      }
      const hint = charts.points?.querySelector(".hint");
      const p = drawn.points?.find((one) => one.group === group);
      hint?.replaceChildren();
      if (!hint || !p || !touched || drawn.labelled.has(group)) return;
      const room = charts.points.clientWidth;
      const back = node(hint, "rect", { height: 23, rx: 5 });
      const text = node(hint, "text", {}, cut(data.groups[group].label, Math.floor(room / LETTER) - 8));
      const width = text.getComputedTextLength() + 16;
      const left = Math.min(Math.max(p.left - width / 2, 2), room - width - 2);
      const top = p.above < 46 ? p.above + 12 : p.above - 36;
      for (const [name, value] of Object.entries({ x: left, y: top, width })) back.setAttribute(name, value);
      text.setAttribute("x", left + 8);
      text.setAttribute("y", top + 16);
    };

    // Point at a setting: say all about it.
    const tell = (group) => {
      current = group;
      charts.points?.querySelectorAll(".point").forEach((one) => {
        const is = one.dataset.group === String(group);
        one.setAttribute("aria-selected", String(is));
        one.setAttribute("tabindex", is ? 0 : -1);
      });
      mark(group);
      const rows = drawn.shown.filter((k) => data.rows[k].group === group);
      if (rows.length) pointed(group, rows, drawn.front?.has(group) ?? false);
    };

    const groupAt = (event) => {
      const found = event.target.closest?.("[data-group]");
      return found ? Number(found.dataset.group) : null;
    };
    for (const chart of Object.values(charts).filter(Boolean)) {
      chart.addEventListener("pointerover", (event) => {
        const group = groupAt(event);
        if (group === null) return;
        touched = true;
        if (pinned) mark(group);
        else if (group !== current) tell(group);
      });
      chart.addEventListener("pointerout", (event) => { if (groupAt(event) !== null) mark(current); });
      chart.addEventListener("click", (event) => {
        const group = groupAt(event);
        pinned = group !== null;
        if (pinned) tell(group);
      });
    }
    charts.points?.addEventListener("focusin", (event) => {
      const group = groupAt(event);
      if (group === null || (pinned && group === current)) return;
      pinned = touched = true;
      tell(group);
    });
    charts.points?.addEventListener("keydown", (event) => {
      const order = drawn.points.map((p) => p.group);
      const now = order.indexOf(current);
      const [left, right] = [now - 1, now + 1];
      const arrows = { ArrowRight: right, ArrowDown: right, ArrowLeft: left, ArrowUp: left };
      const next = { ...arrows, Home: 0, End: order.length }[event.key];
      if (event.key === "Escape") pinned = false;
      if (next === undefined) return;
      event.preventDefault();
      const group = order[Math.min(Math.max(next, 0), order.length - 1)];
      charts.points.querySelector(`[data-group="${group}"]`)?.focus();
    });

    const draw = () => {
      if (!drawn) return;
      drawPoints();
      drawCurves();
      mark(current);
    };
    const widths = new Map();
    const sized = new ResizeObserver((entries) => {
      const changed = entries.filter(({ target }) => widths.get(target) !== target.clientWidth);
      for (const { target } of changed) widths.set(target, target.clientWidth);
      if (changed.length) draw();
    });
    for (const chart of Object.values(charts).filter(Boolean)) sized.observe(chart);

    return {
      draw: (shown, x, y, picture) => {
        drawn = { shown, x, y, picture };
        draw();
      },
      mark: (group) => {
        touched = true;
        mark(group ?? current);
      },
    };
  };
}
