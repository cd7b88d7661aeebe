// <button data-copy>: copies the text of the <code> beside it, and says so.
"use strict";
for (const button of document.querySelectorAll("[data-copy]")) {
  const code = button.parentElement.querySelector("code");
  const label = button.textContent;
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(code.textContent);
      return true;
    } catch { // an older way, for browsers that keep the clipboard from files
      getSelection().selectAllChildren(code);
      return document.execCommand("copy");
    }
  };
  button.setAttribute("aria-live", "polite");
  button.addEventListener("click", async () => {
    button.textContent = (await copy()) ? "Copied" : "Press Ctrl+C";
    setTimeout(() => { button.textContent = label; }, 1600);
  });
}
