// Light or dark: follows the system until the reader chooses. Runs in the head, before anything is shown.
"use strict";
{
  const { dataset } = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (dataset.theme ? dataset.theme === "dark" : system.matches);
  try { dataset.theme = localStorage.brushexpTheme ?? ""; } catch {} // a browser may refuse storage to files

  const show = () => document.querySelector("[data-theme-toggle]")?.setAttribute("aria-pressed", isDark());
  addEventListener("click", (event) => {
    if (!event.target.closest("[data-theme-toggle]")) return;
    dataset.theme = isDark() ? "light" : "dark";
    try { localStorage.brushexpTheme = dataset.theme; } catch {}
    show();
  });
  for (const moment of ["DOMContentLoaded", "load"]) addEventListener(moment, show);
}
