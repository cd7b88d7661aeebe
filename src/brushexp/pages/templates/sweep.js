// The page of a sweep: sort and filter its runs, compare two side by side, and describe the run under the pointer.
"use strict";
{
  const { brushexp } = window;
  const { byId } = brushexp;
  const on = (ids, type, react) => ids.forEach((id) => byId(id)?.addEventListener(type, react));
  const data = JSON.parse(byId("data").textContent);
  const rows = [...document.querySelectorAll("tr[data-row]")]; // in the order of data.rows, however the table is sorted
  const runOf = (k) => data.rows[k];
  const write = (id, text) => { byId(id).textContent = text; };
  const make = (tag, textContent, parent) =>
    parent.appendChild(Object.assign(document.createElement(tag), { textContent }));

  // ---- the charts, and the text beside them ----
  let told = null; // row described beside the charts

  const tell = (group, found, isFirst) => {
    const runs = found.map(runOf);
    [told] = found;
    byId("pointed").hidden = false;
    write("pointed-label", data.groups[group].label);
    const names = `${runs.length > 1 ? "means of runs" : "run"} ${runs.map((run) => run.name).join(", ")}`;
    write("pointed-runs", isFirst ? `${names}, on the front` : names);
    byId("pointed-numbers").replaceChildren();
    for (const { key, name, digits } of data.metrics) {
      const values = runs.map((run) => run.numbers[key]).filter(Number.isFinite);
      if (!values.length) continue;
      const pair = make("div", "", byId("pointed-numbers"));
      make("dt", name, pair);
      make("dd", brushexp.chart.mean(values).toFixed(digits), pair);
    }
    const picture = rows[told].querySelector(".picture");
    write("pointed-command", runs[0].command);
    byId("pointed-picture").replaceChildren(...(picture ? [picture.cloneNode(true)] : []));
    byId("pointed-report").hidden = !runs[0].report;
    byId("pointed-report").setAttribute("href", runs[0].report);
    byId("pointed-compare").disabled = !picture;
  };

  const draw = brushexp.sweepCharts(data, tell);
  const drawCharts = () => {
    const shown = [...rows.keys()].filter((k) => !rows[k].hidden);
    draw(shown, byId("along")?.value, byId("up")?.value, Number(byId("of-picture")?.value ?? 0));
  };
  on(["along", "up", "of-picture"], "change", drawCharts);

  // ---- the filter: all words, and one of the ticked values of each setting ----
  const filters = [...document.querySelectorAll(".choices")]; // in the order of data.axes
  const ticked = (filter) => [...filter.querySelectorAll("input:checked")].map((input) => Number(input.value));
  const texts = data.rows.map((run) => `run ${run.name} ${run.command} ${run.error}`.toLowerCase());

  const filter = () => {
    const words = byId("words").value.toLowerCase().split(/\s+/).filter(Boolean);
    const wanted = filters.map(ticked);
    for (const [k, row] of rows.entries()) {
      const fits = wanted.every((values, axis) => !values.length || values.includes(runOf(k).chosen[axis]));
      row.hidden = !fits || !words.every((word) => texts[k].includes(word));
    }
    for (const [axis, one] of filters.entries()) {
      one.previousElementSibling.dataset.count = wanted[axis].length || "";
    }
    const shown = rows.filter((row) => !row.hidden).length;
    write("count", `${shown} of ${rows.length} runs`);
    byId("clear").hidden = !words.length && !wanted.flat().length;
    drawCharts();
  };
  on(["words"], "input", filter);
  for (const one of filters) one.addEventListener("change", filter);
  on(["clear"], "click", () => {
    byId("words").value = "";
    for (const input of filters.flatMap((one) => [...one.querySelectorAll("input")])) input.checked = false;
    filter();
    byId("words").focus();
  });

  const narrow = matchMedia("(max-width: 48rem)");
  const view = () => {
    const cards = narrow.matches || document.querySelector("[name=view]:checked").value === "cards";
    byId("runs").classList.toggle("as-cards", cards);
  };
  for (const one of [narrow, ...document.querySelectorAll("[name=view]")]) one.addEventListener("change", view);

  // ---- two side by side ----
  let chosen = null; // row that waits for a second one
  const choose = (k) => {
    if (chosen !== null && k !== chosen) open(`run ${chosen}`, `run ${k}`);
    chosen = chosen === null ? k : null;
    for (const [each, row] of rows.entries()) row.querySelector(".choose input").checked = each === chosen;
  };
  for (const [k, row] of rows.entries()) row.querySelector(".choose input").addEventListener("change", () => choose(k));
  on(["pointed-compare"], "click", () => choose(told));

  // A side of the comparison is "target 0" or "run 12".
  const dialog = byId("beside");
  const stage = dialog.querySelector(".wipe");
  const sides = new Map();
  for (const { dataset, firstChild } of document.querySelectorAll("[data-right]")) {
    sides.set(dataset.right, firstChild);
    for (const id of ["left", "right"]) byId(id).append(new Option(firstChild.alt, dataset.right));
  }

  // The table below the pictures: settings that differ, and all metrics.
  const tabulate = (left, right) => {
    const body = byId("differences").tBodies[0];
    const line = (name, ...texts) => {
      const row = body.insertRow();
      make("th", name, row).scope = "row";
      for (const text of texts) make("td", text, row).className = "number";
    };
    body.replaceChildren();
    for (const [k, axis] of data.axes.entries()) {
      const values = [left, right].map((run) => (run ? axis.shown[run.chosen[k]] : "–"));
      if (values[0] !== values[1]) line(axis.key, ...values, "");
    }
    for (const { key, name, digits } of data.metrics) {
      const gain = right?.numbers[key] - left?.numbers[key];
      const change = Number.isFinite(gain) ? (gain > 0 ? "+" : "") + gain.toFixed(digits).replace("-", "−") : "";
      line(name, left?.cells[key] ?? "–", right?.cells[key] ?? "–", change);
    }
  };
  const showSides = () => {
    const shown = ["left", "right"].map((id) => byId(id).value);
    const [images, labels] = ["img", ".wipe-label"].map((name) => stage.querySelectorAll(name));
    for (const [k, { src, alt }] of shown.map((side) => sides.get(side)).entries()) {
      Object.assign(images[k], { src, alt });
      labels[k].textContent = alt;
      write(["left-name", "right-name"][k], alt.split(":")[0]);
    }
    const { width, height } = sides.get(shown[1]).attributes;
    Object.assign(stage.dataset, { width: width.value, height: height.value });
    brushexp.fit(stage);
    tabulate(...shown.map((side) => (side.startsWith("run ") ? runOf(Number(side.slice(4))) : null)));
  };
  const open = (left, right) => {
    [byId("left").value, byId("right").value] = [left, right];
    showSides();
    dialog.showModal();
    dialog.querySelector("input[type=range]").focus();
  };
  on(["left", "right"], "change", showSides);
  document.addEventListener("click", (event) => {
    const picture = event.target.closest("[data-right]");
    if (picture) open(picture.dataset.left, picture.dataset.right);
  });

  view();
  filter(); // a reload keeps the fields of the filter
}
