// Light or dark: as the system says, until the reader chooses. Runs in the head, before anything is shown.
"use strict";
{
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const KEY = "brushexp-theme";
  const stored = (value) => {
    try { // a browser may refuse storage to files
      if (value) localStorage.setItem(KEY, value);
      return localStorage.getItem(KEY);
    } catch {
      return null;
    }
  };
  const theme = () => root.dataset.theme || (dark.matches ? "dark" : "light");
  const chosen = stored();
  if (chosen === "light" || chosen === "dark") root.dataset.theme = chosen;

  addEventListener("DOMContentLoaded", () => {
    const button = document.querySelector("[data-theme-toggle]");
    const show = () => button.setAttribute("aria-pressed", String(theme() === "dark"));
    button.addEventListener("click", () => {
      root.dataset.theme = theme() === "dark" ? "light" : "dark";
      stored(root.dataset.theme);
      show();
      dispatchEvent(new Event("themechange"));
    });
    dark.addEventListener("change", show);
    show();
  });
}
