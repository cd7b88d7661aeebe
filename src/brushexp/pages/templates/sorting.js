// Sortable tables: click a column's head to sort, best first; empty cells come last.
"use strict";
{
  const collator = new Intl.Collator("en", { numeric: true });
  const opposite = { ascending: "descending", descending: "ascending" };
  const valueOf = (row, column) => {
    let [k, left] = [0, column];
    while (left >= row.cells[k].colSpan) left -= row.cells[k++].colSpan; // an error spans all number columns
    const text = row.cells[k].dataset.sort ?? row.cells[k].textContent.trim();
    return text !== "" && Number.isFinite(Number(text)) ? Number(text) : text;
  };
  const compare = (a, b) => (typeof a === "number" && typeof b === "number" ? a - b : collator.compare(a, b));
  const sort = (table, column, direction) => {
    const sign = direction === "ascending" ? 1 : -1;
    const keyed = [...table.tBodies[0].rows].map((row) => [valueOf(row, column), row]);
    keyed.sort(([a], [b]) => (a === "" || b === "" ? (a === "") - (b === "") : sign * compare(a, b)));
    table.tBodies[0].append(...keyed.map(([, row]) => row));
    for (const head of table.tHead.querySelectorAll("[aria-sort]"))
      head.setAttribute("aria-sort", head.cellIndex === column ? direction : "none");
  };
  for (const button of document.querySelectorAll(".sortable thead button")) {
    const { first } = button.dataset;
    const head = button.closest("th");
    const table = head.closest("table");
    button.addEventListener("click", () => sort(table, head.cellIndex, opposite[head.ariaSort] ?? first));
  }
}
