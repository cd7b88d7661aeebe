// Add, delete, split and join strokes by hand, and save them as marks (docs/recovery.md). The view calls
// "brushexp.marks" to draw them, and forwards taps and drags while a tool is chosen.
"use strict";
{
  const { byId, recovered } = window.brushexp;
  const { data, shown } = recovered;
  const { outlines, lines, columns, width, height, name: image } = data;
  const VERSION = 1; // of the marks file
  const COLORS = { hand: "#ffd83d", recovery: "#5cb8ff" };
  const SPACING = 3; // screen pixels between the points of a drawn stroke
  const NEAREST = 1e-6;
  const words = {
    none: "Choose a tool.",
    add: "Drag along a stroke, or press Enter at its points and twice at its end.",
    delete: "Tap a stroke, or press Enter when the cross is on it.",
    split: "Drag a line across a stroke, or press Enter on both sides of it.",
    join: "Tap two strokes, or press Enter on each.",
  };
  let marks = null; // {name, points, width, outlines, by}; null before the first correction
  let deleted = [];
  let undone = []; // states before each change
  let tool = "none";
  let first = -1; // the first of two strokes to join
  let drawn = []; // points of the unfinished stroke or cut

  const copyOf = () => ({ marks: [...marks], deleted: [...deleted] });
  const round = (value) => Math.round(10 * value) / 10;
  const start = () => {
    marks ??= shown().map((k) => ({
      name: `${columns.stroke[k]}`, points: lines[k], width: [columns.width[k]], outlines: [outlines[k]], by: "recovery",
    }));
  };

  // Geometry of marks.
  const pathOf = (mark) => {
    const path = new Path2D();
    if (mark.outlines.length)
      for (const outline of mark.outlines) {
        outline.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
        path.closePath();
      }
    else mark.points.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
    return path;
  };
  const side = ([x, y], [[ax, ay], [bx, by]]) => (bx - ax) * (y - ay) - (by - ay) * (x - ax);
  const crossing = (p, q, cut) => {
    const [from, to] = [side(p, cut), side(q, cut)];
    const share = from / (from - to);
    return [p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])].map(round);
  };
  const half = (outline, cut, sign) => {
    const kept = [];
    outline.forEach((point, k) => {
      const next = outline[(k + 1) % outline.length];
      const [here, there] = [sign * side(point, cut) >= 0, sign * side(next, cut) >= 0];
      if (here) kept.push(point);
      if (here !== there) kept.push(crossing(point, next, cut));
    });
    return kept;
  };
  const parts = (p, q, line) => side(p, line) >= 0 !== side(q, line) >= 0;
  const meets = (p, q, [a, b]) => parts(p, q, [a, b]) && parts(a, b, [p, q]);
  const widthAt = (mark, k) => mark.width[mark.width.length > 1 ? k : 0];
  const halvesOf = (mark, cut) => {
    const at = mark.points.findIndex((point, k) => k > 0 && meets(mark.points[k - 1], point, cut));
    if (at < 0) return null;
    const place = crossing(mark.points[at - 1], mark.points[at], cut);
    const breadth = (widthAt(mark, at - 1) + widthAt(mark, at)) / 2;
    const breadths = mark.points.map((_, k) => widthAt(mark, k));
    const parts = [
      { points: [...mark.points.slice(0, at), place], width: [...breadths.slice(0, at), breadth] },
      { points: [place, ...mark.points.slice(at)], width: [breadth, ...breadths.slice(at)] },
    ];
    const way = Math.sign(side(mark.points[at - 1], cut)) || 1;
    return parts.map((part, k) => ({
      ...part, name: `${mark.name}${"ab"[k]}`, by: "hand",
      outlines: mark.outlines.map((outline) => half(outline, cut, k ? -way : way)).filter((outline) => outline.length > 2),
    }));
  };
  const distance = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]);
  const joined = (one, other) => {
    const ends = (mark) => [mark.points[0], mark.points.at(-1)];
    const gaps = ends(one).flatMap((p) => ends(other).map((q) => distance(p, q)));
    const nearest = gaps.indexOf(Math.min(...gaps));
    const turned = (mark, turn) => {
      const points = mark.points.map((point, k) => [point, widthAt(mark, k)]);
      return turn ? points.reverse() : points;
    };
    const points = [...turned(one, nearest < 2), ...turned(other, nearest % 2 === 1)];
    const isLine = !one.outlines.length && !other.outlines.length;
    return {
      name: `${one.name}+${other.name}`, by: "hand", points: points.map(([point]) => point), width: points.map(([, breadth]) => breadth),
      outlines: isLine ? [] : [one, other].flatMap((mark) => (mark.outlines.length ? mark.outlines : [outlineOf(mark)])),
    };
  };
  const outlineOf = (mark) => {
    const sides = [[], []];
    mark.points.forEach((point, k) => {
      const [from, to] = [mark.points[Math.max(k - 1, 0)], mark.points[Math.min(k + 1, mark.points.length - 1)]];
      const [x, y] = [to[0] - from[0], to[1] - from[1]];
      const [long, breadth] = [Math.max(Math.hypot(x, y), NEAREST), widthAt(mark, k) / 2];
      for (const [number, sign] of [[0, 1], [1, -1]]) sides[number].push([point[0] - (sign * breadth * y) / long, point[1] + (sign * breadth * x) / long].map(round));
    });
    return [...sides[0], ...sides[1].reverse()];
  };
  const isOn = (pen, mark, x, y) => {
    const path = pathOf(mark);
    if (mark.outlines.length) return pen.isPointInPath(path, x, y);
    pen.lineWidth = Math.max(...mark.width);
    pen.lineCap = "round";
    return pen.isPointInStroke(path, x, y);
  };
  const at = (pen, [x, y]) => marks.findLastIndex((mark) => isOn(pen, mark, x, y));

  // Tools; each use is one step of undo.
  const change = (next, gone = []) => {
    undone.push(copyOf());
    marks = next;
    deleted = [...deleted, ...gone.filter((mark) => mark.by === "recovery")];
    tell();
  };
  const remove = (k) => k >= 0 && change(marks.filter((_, number) => number !== k), [marks[k]]);
  const add = (points) => {
    const breadth = Number(byId("mark-width").value);
    change([...marks, { name: `hand ${marks.length + 1}`, points: points.map((point) => point.map(round)), width: [breadth], outlines: [], by: "hand" }]);
  };
  const split = (cut) => {
    const parts = marks.map((mark) => halvesOf(mark, cut));
    if (parts.some((part) => part)) change(marks.flatMap((mark, k) => parts[k] ?? [mark]), marks.filter((_, k) => parts[k]));
  };
  const join = (k) => {
    if (k < 0 || k === first) first = -1;
    else if (first < 0) first = k;
    else {
      const one = joined(marks[first], marks[k]);
      const pair = [first, k];
      first = -1;
      change([...marks.filter((_, number) => !pair.includes(number)), one], pair.map((number) => marks[number]));
    }
    tell();
  };
  const undo = () => {
    drawn = [];
    first = -1;
    if (undone.length) ({ marks, deleted } = undone.pop());
    tell();
  };

  const tap = (pen, place) => {
    if (tool === "delete") remove(at(pen, place));
    if (tool === "join") join(at(pen, place));
  };
  const drag = (place, zoom) => {
    if (!drawn.length || distance(drawn.at(-1), place) * zoom >= SPACING) drawn.push(place);
  };
  const drop = () => {
    const points = drawn;
    drawn = [];
    if (points.length < 2) return;
    if (tool === "add") add(points);
    if (tool === "split") split([points[0], points.at(-1)]);
  };
  const enter = (pen, place) => {
    if (tool === "delete" || tool === "join") return tap(pen, place);
    const isAgain = drawn.length > 0 && distance(drawn.at(-1), place) < NEAREST;
    if (!isAgain) drawn.push(place);
    if (isAgain || (tool === "split" && drawn.length === 2)) drop();
    return tell();
  };

  const line = (pen, path, color, breadth) => {
    pen.lineCap = "butt";
    for (const [style, wide] of [["rgb(0 0 0 / 55%)", breadth + 1.6 / pen.getTransform().a], [color, breadth]]) {
      pen.strokeStyle = style;
      pen.lineWidth = wide;
      pen.stroke(path);
    }
  };
  const paint = (pen, zoom, centre) => {
    const thin = 1.4 / zoom;
    marks.forEach((mark, k) => {
      const color = k === first ? "#ffffff" : COLORS[mark.by];
      if (mark.outlines.length) return line(pen, pathOf(mark), color, k === first ? 2 * thin : thin);
      pen.globalAlpha = 0.5;
      pen.lineCap = "round";
      pen.strokeStyle = color;
      pen.lineWidth = mark.width[0];
      pen.stroke(pathOf(mark));
      pen.globalAlpha = 1;
      return line(pen, pathOf(mark), color, thin);
    });
    if (drawn.length) line(pen, pathOf({ points: [...drawn, ...(centre ? [centre] : [])], outlines: [] }), "#ff5a4d", 2 * thin);
    if (!centre) return;
    const [x, y] = centre;
    const cross = new Path2D(`M${x - 9 / zoom} ${y}H${x + 9 / zoom}M${x} ${y - 9 / zoom}V${y + 9 / zoom}`);
    line(pen, cross, "#ffffff", thin);
  };

  // The file.
  const text = () => JSON.stringify({
    format: "brushexp marks", version: VERSION, image, size: [width, height],
    strokes: marks.map(({ name, points, width: breadth, outlines: rings, by }) => ({ name, points, width: breadth, ...(rings.length ? { outlines: rings } : {}), by })),
    deleted: deleted.map(({ name, points, width: breadth, outlines: rings }) => ({ name, points, width: breadth, outlines: rings, by: "recovery" })),
  });
  const save = () => {
    start();
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text()], { type: "application/json" }));
    link.download = "marks.json";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };
  const open = async (file) => {
    try {
      const values = JSON.parse(await file.text());
      if ((values.version ?? VERSION) > VERSION) {
        byId("mark-count").textContent = `${file.name} was written by a later version; update brushexp.`;
        return;
      }
      const read = (mark, k) => {
        if (!mark.points.length || !mark.points.flat().every(Number.isFinite)) throw new Error("no places");
        return { name: mark.name ?? `stroke ${k + 1}`, points: mark.points, width: [mark.width].flat(), outlines: mark.outlines ?? [], by: mark.by ?? "hand" };
      };
      const next = { marks: values.strokes.map(read), deleted: (values.deleted ?? []).map(read) };
      start();
      undone.push(copyOf());
      ({ marks, deleted } = next);
      tell();
    } catch {
      byId("mark-count").textContent = `${file.name} has no marks; open a file from Save marks.`;
    }
  };
  const tell = () => {
    const hand = marks?.filter((mark) => mark.by === "hand").length ?? 0;
    byId("mark-count").textContent = marks ? `${marks.length.toLocaleString("en")} strokes, ${hand.toLocaleString("en")} by hand; ${deleted.length.toLocaleString("en")} recovered strokes deleted.` : "";
    byId("mark-help").textContent = words[tool];
    document.dispatchEvent(new Event("marked"));
  };
  const choose = (name) => {
    tool = name;
    first = -1;
    drawn = [];
    if (tool !== "none") start();
    for (const button of document.querySelectorAll("[data-tool]")) button.setAttribute("aria-pressed", button.dataset.tool === tool);
    tell();
  };
  const actions = {
    undo,
    save,
    empty: () => {
      start();
      change([], marks);
    },
    open: () => byId("mark-file").click(),
  };
  for (const button of document.querySelectorAll("[data-tool]")) button.addEventListener("click", () => choose(tool === button.dataset.tool ? "none" : button.dataset.tool));
  for (const button of document.querySelectorAll("[data-marks]")) button.addEventListener("click", actions[button.dataset.marks]);
  byId("mark-file").addEventListener("change", (event) => event.target.files[0] && open(event.target.files[0]));
  byId("mark-width").addEventListener("input", () => { document.querySelector("output[for=mark-width]").textContent = byId("mark-width").value; });
  const widen = (step) => {
    const slider = byId("mark-width");
    slider.value = Number(slider.value) + step;
    slider.dispatchEvent(new Event("input"));
  };
  const keys = { a: () => choose("add"), d: () => choose("delete"), s: () => choose("split"), j: () => choose("join"), u: undo, "[": () => widen(-1), "]": () => widen(1) };

  window.brushexp.marks = {
    keys, tap, drag, drop, enter, paint,
    isOpen: () => marks !== null,
    isBusy: () => tool !== "none",
    takesDrags: () => tool === "add" || tool === "split",
    leave: () => choose("none"),
  };
}
