// The page of a sweep: sort and filter its runs, put two side by side, and say what a plot points at.
"use strict";
{
  const { brushexp } = window;
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("data").textContent);
  const rows = [...document.querySelectorAll("tr[data-row]")]; // in the order of data.rows, whatever is sorted
  const collator = new Intl.Collator("en", { numeric: true });

  // The plots.

  const groupOf = (k) => data.rows[k].group;
  const picture = (k) => rows[k].querySelector(".pictured img");
  let told = null; // row that is told of beside the plots

  const pointed = (group, found, isFirst) => {
    const runs = found.map((k) => data.rows[k]);
    [told] = found;
    byId("pointed").hidden = false;
    byId("pointed-label").textContent = data.groups[group].label;
    const numbers = byId("pointed-numbers");
    numbers.replaceChildren();
    const say = (name, value) => {
      const pair = document.createElement("div");
      for (const [tag, text] of [["dt", name], ["dd", value]])
        pair.appendChild(document.createElement(tag)).textContent = text;
      numbers.append(pair);
    };
    const all = runs.map((run) => run.name).join(", ");
    const names = runs.length > 1 ? `means of runs ${all}` : `run ${all}`;
    byId("pointed-runs").textContent = isFirst ? `${names}, on the front` : names;
    for (const metric of data.metrics) {
      const values = runs.map((run) => run.numbers[metric.key]).filter(Number.isFinite);
      const middle = values.reduce((sum, value) => sum + value, 0) / values.length;
      if (values.length) say(metric.name, middle.toFixed(metric.digits));
    }
    byId("pointed-command").textContent = runs[0].command;
    byId("pointed-picture").hidden = !picture(told);
    if (picture(told)) show(byId("pointed-picture").querySelector("img"), picture(told));
    byId("pointed-report").hidden = !runs[0].report;
    if (runs[0].report) byId("pointed-report").setAttribute("href", runs[0].report);
    byId("pointed-compare").disabled = !picture(told);
    byId("pointed-compare").setAttribute("aria-pressed", String(chosen.includes(told)));
    for (const [k, row] of rows.entries()) row.classList.toggle("hot", groupOf(k) === group);
  };
  const show = (image, like) => {
    for (const name of ["src", "alt", "width", "height"]) image.setAttribute(name, like.getAttribute(name));
  };

  const plots = brushexp.plots(data, pointed);
  const drawPlots = () => {
    const shown = [...rows.keys()].filter((k) => !rows[k].hidden);
    plots.draw(shown, byId("along")?.value ?? "", byId("up")?.value ?? "", Number(byId("of-picture")?.value ?? 0));
  };
  for (const id of ["along", "up", "of-picture"]) byId(id)?.addEventListener("change", drawPlots);
  for (const [k, row] of rows.entries()) {
    row.addEventListener("pointerenter", () => plots.mark(groupOf(k)));
    row.addEventListener("pointerleave", () => plots.mark(null));
  }

  // The filter: all words, and of each setting one of the values that are ticked.

  const filters = [...document.querySelectorAll("details[data-axis]")];
  const ticked = (filter) => [...filter.querySelectorAll("input:checked")].map((input) => Number(input.value));
  const texts = data.rows.map((row) => {
    const settings = data.axes.map((axis, k) => `${axis.key}=${axis.values[row.chosen[k]]}`);
    return [`run ${row.name}`, row.label, row.error, ...settings].join(" ").toLowerCase();
  });

  const filter = () => {
    const words = byId("words").value.toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = filters.map((one) => [Number(one.dataset.axis), ticked(one)]).filter(([, values]) => values.length);
    for (const [k, row] of rows.entries()) {
      const fits = wanted.every(([axis, values]) => values.includes(data.rows[k].chosen[axis]));
      row.hidden = !fits || !words.every((word) => texts[k].includes(word));
    }
    for (const one of filters) {
      const count = ticked(one).length;
      one.querySelector(".count").textContent = count ? ` ${count}` : "";
      one.classList.toggle("active", count > 0);
    }
    const shown = rows.filter((row) => !row.hidden).length;
    byId("count").textContent = `${shown} of ${rows.length} runs`;
    byId("clear").hidden = !words.length && !wanted.length;
    byId("none").hidden = shown > 0;
    byId("table").hidden = shown === 0;
    drawPlots();
  };
  const clear = () => {
    byId("words").value = "";
    for (const one of filters) for (const input of one.querySelectorAll("input")) input.checked = false;
    filter();
    byId("words").focus();
  };
  byId("words").addEventListener("input", filter);
  for (const one of filters) one.addEventListener("change", filter);
  for (const id of ["clear", "clear-too"]) byId(id).addEventListener("click", clear);
  document.addEventListener("pointerdown", (event) => {
    for (const one of filters) if (!one.contains(event.target)) one.open = false;
  });
  document.addEventListener("keydown", (event) => {
    const open = filters.find((one) => one.open);
    if (event.key !== "Escape" || !open) return;
    open.open = false;
    open.querySelector("summary").focus();
  });

  // The order: a click on a head, the better end first; what has no value stands last.

  const valueOf = (row, column) => {
    let [k, left] = [0, column];
    while (left >= row.cells[k].colSpan) left -= row.cells[k++].colSpan; // an error stands in place of all numbers
    const cell = row.cells[k];
    const text = cell.dataset.sort ?? cell.textContent.trim();
    return text !== "" && Number.isFinite(Number(text)) ? Number(text) : text;
  };
  const compare = (a, b, sign) => {
    if (a === "" || b === "") return (a === "") - (b === "");
    if (typeof a === "number" && typeof b === "number") return sign * (a - b);
    return sign * collator.compare(a, b);
  };
  const sort = (table, column, direction) => {
    const sign = direction === "ascending" ? 1 : -1;
    const body = table.tBodies[0];
    const keyed = [...body.rows].map((row) => [row, valueOf(row, column)]);
    body.append(...keyed.sort(([, a], [, b]) => compare(a, b, sign)).map(([row]) => row));
    for (const head of table.tHead.querySelectorAll("[aria-sort]"))
      head.setAttribute("aria-sort", head.cellIndex === column ? direction : "none");
    if (table === byId("table")) byId("order").value = `${column} ${direction}`;
  };
  const opposite = { ascending: "descending", descending: "ascending" };
  for (const button of document.querySelectorAll(".sortable thead button")) {
    const head = button.closest("th");
    const table = head.closest("table");
    button.addEventListener("click", () => {
      const now = head.getAttribute("aria-sort");
      sort(table, head.cellIndex, now === "none" ? button.dataset.first : opposite[now]);
    });
    if (table !== byId("table")) continue;
    const other = opposite[button.dataset.first];
    for (const direction of [button.dataset.first, other]) {
      const text = `${button.textContent}${direction === "ascending" ? ", rising" : ", falling"}`;
      byId("order").append(new Option(text, `${head.cellIndex} ${direction}`));
    }
  }
  byId("order").addEventListener("change", () => {
    const [column, direction] = byId("order").value.split(" ");
    sort(byId("table"), Number(column), direction);
  });

  const narrow = matchMedia("(max-width: 48rem)");
  const view = () => {
    const cards = narrow.matches || document.querySelector("[name=view]:checked").value === "cards";
    byId("runs").classList.toggle("as-cards", cards);
  };
  narrow.addEventListener("change", view);
  for (const input of document.querySelectorAll("[name=view]")) input.addEventListener("change", view);

  // Two side by side.

  let chosen = []; // rows, two at most; a third takes the place of the first
  const choose = (k) => {
    chosen = chosen.includes(k) ? chosen.filter((one) => one !== k) : [...chosen, k].slice(-2);
    showChosen();
  };
  const showChosen = () => {
    for (const [k, row] of rows.entries()) {
      row.querySelector(".choose input").checked = chosen.includes(k);
      row.classList.toggle("chosen", chosen.includes(k));
    }
    byId("pointed-compare")?.setAttribute("aria-pressed", String(chosen.includes(told)));
    byId("tray").hidden = chosen.length === 0;
    const names = chosen.map((k) => `run ${data.rows[k].name} (${data.rows[k].label})`);
    byId("tray-say").textContent = names.length === 1 ? `${names[0]}: choose one more` : names.join(" and ");
    byId("tray-open").disabled = chosen.length < 2;
  };
  for (const [k, row] of rows.entries()) row.querySelector(".choose input").addEventListener("change", () => choose(k));
  byId("pointed-compare")?.addEventListener("click", () => choose(told));
  byId("tray-clear").addEventListener("click", () => { chosen = []; showChosen(); });

  // Sides are "target 0" or "run 12".
  const dialog = byId("beside");
  const sides = new Map();
  for (const figure of document.querySelectorAll("figure[data-target]"))
    sides.set(`target ${figure.dataset.target}`, { image: figure.querySelector("img"), name: figure.dataset.name });
  for (const [k, row] of data.rows.entries())
    if (picture(k)) sides.set(`run ${k}`, { image: picture(k), name: `run ${row.name}`, row });
  for (const [value, side] of sides)
    for (const select of [byId("left"), byId("right")])
      select.append(new Option(side.row ? `${side.name}: ${side.row.label}` : side.name, value));

  const differ = (left, right) => {
    const line = (name, ...texts) => {
      const row = byId("differences").tBodies[0].insertRow();
      const head = document.createElement("th");
      head.scope = "row";
      head.textContent = name;
      row.append(head);
      for (const text of texts) Object.assign(row.insertCell(), { className: "number", textContent: text });
      return row.lastElementChild;
    };
    byId("differences").tBodies[0].replaceChildren();
    for (const [k, axis] of data.axes.entries()) {
      const values = [left, right].map((row) => (row ? axis.shown[row.chosen[k]] : "–"));
      if (values[0] !== values[1]) line(axis.key, ...values, "");
    }
    for (const { key, name, digits, better } of data.metrics) {
      const [a, b] = [left, right].map((row) => row?.numbers[key]);
      const gain = Number((b - a).toFixed(digits));
      const sign = gain > 0 ? "+" : gain < 0 ? "−" : "";
      const text = Number.isFinite(gain) ? sign + Math.abs(gain).toFixed(digits) : "";
      const cell = line(name, left?.cells[key] ?? "–", right?.cells[key] ?? "–", text);
      if (better && gain) cell.classList.add(gain > 0 === (better === "higher") ? "good" : "alarm");
    }
  };
  const besides = () => {
    const stage = dialog.querySelector(".wipe");
    const found = [sides.get(byId("left").value), sides.get(byId("right").value)];
    for (const [k, { image, name, row }] of found.entries()) {
      const drawn = stage.querySelectorAll("img")[k];
      show(drawn, image);
      drawn.alt = row ? `${name}: ${row.label}` : name;
      stage.querySelectorAll(".wipe-label")[k].textContent = drawn.alt;
      byId(k ? "right-name" : "left-name").textContent = name;
    }
    stage.dataset.width = found[1].image.getAttribute("width");
    stage.dataset.height = found[1].image.getAttribute("height");
    brushexp.fit(stage);
    differ(found[0].row, found[1].row);
  };
  const open = (left, right) => {
    byId("left").value = left;
    byId("right").value = right;
    besides();
    dialog.showModal();
    dialog.querySelector("input[type=range]").focus();
  };
  const enlarge = (k) => {
    const target = `target ${data.rows[k].target}`;
    open(sides.has(target) ? target : `run ${k}`, `run ${k}`);
  };
  for (const select of [byId("left"), byId("right")]) select.addEventListener("change", besides);
  for (const button of document.querySelectorAll("[data-enlarge]"))
    button.addEventListener("click", () => enlarge(Number(button.dataset.enlarge)));
  for (const button of document.querySelectorAll("[data-enlarge-target]")) {
    const target = `target ${button.dataset.enlargeTarget}`;
    const best = [...data.rows.keys()].find((k) => picture(k) && `target ${data.rows[k].target}` === target);
    button.addEventListener("click", () => open(target, best === undefined ? target : `run ${best}`));
  }
  byId("pointed-picture")?.addEventListener("click", () => enlarge(told));
  byId("tray-open").addEventListener("click", () => open(`run ${chosen[0]}`, `run ${chosen[1]}`));
  byId("beside-close").addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });

  view();
  filter(); // a reload keeps what was typed and ticked
  const now = byId("table").tHead.rows[0].querySelector("th button").closest("th").cellIndex;
  byId("order").value = `${now} ascending`;
  showChosen();
}
