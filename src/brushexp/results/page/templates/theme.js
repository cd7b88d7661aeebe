// Light or dark: as the system says, until the reader chooses. Runs in the head, before anything is shown.
"use strict";
{
  const KEY = "brushexp-theme";
  const { dataset } = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (dataset.theme ? dataset.theme === "dark" : system.matches);
  try { // a browser may refuse storage to files
    const chosen = localStorage.getItem(KEY);
    if (chosen === "light" || chosen === "dark") dataset.theme = chosen;
  } catch {}

  addEventListener("DOMContentLoaded", () => {
    const button = document.querySelector("[data-theme-toggle]");
    const show = () => button.setAttribute("aria-pressed", isDark());
    button.addEventListener("click", () => {
      dataset.theme = isDark() ? "light" : "dark";
      try { localStorage.setItem(KEY, dataset.theme); } catch {}
      show();
    });
    system.addEventListener("change", show);
    show();
  });
}
