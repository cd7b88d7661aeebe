// Light or dark: as the system says, until the reader chooses. Runs in the head, before anything is shown.
"use strict";
{
  const { dataset } = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (dataset.theme ? dataset.theme === "dark" : system.matches);
  try { dataset.theme = localStorage.brushexpTheme ?? ""; } catch {} // a browser may refuse storage to files

  addEventListener("DOMContentLoaded", () => {
    const button = document.querySelector("[data-theme-toggle]");
    const show = () => button.setAttribute("aria-pressed", isDark());
    button.addEventListener("click", () => {
      dataset.theme = isDark() ? "light" : "dark";
      try { localStorage.brushexpTheme = dataset.theme; } catch {}
      show();
    });
    show();
  });
}
