// Behaviour of the elements of pieces.html.j2 in the loaded page. window.brushexp offers byId, drag and fit to other
// scripts.
"use strict";
{
  const brushexp = (window.brushexp ??= {});
  brushexp.byId = (id) => document.getElementById(id);

  // Call follow(x, y) with positions in an element, 0 to 1, while a pointer is down in it.
  brushexp.drag = (element, follow) => {
    const at = (event) => {
      const box = element.getBoundingClientRect();
      follow((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    };
    element.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      event.preventDefault(); // no selection, no dragging of the picture
      element.setPointerCapture(event.pointerId);
      at(event);
    });
    element.addEventListener("pointermove", (event) => { if (element.hasPointerCapture(event.pointerId)) at(event); });
  };

  // <img data-of="#id"> shows the same picture as another image, so that the file contains it once.
  for (const one of document.querySelectorAll("img[data-of]")) one.src = document.querySelector(one.dataset.of).src;

  // A .stage, or an element of its width, takes the shape of its picture.
  brushexp.fit = (stage) => stage.style.setProperty("--ratio", stage.dataset.width / stage.dataset.height);
  document.querySelectorAll("[data-width]").forEach(brushexp.fit);

  // <div class="stage wipe">: two pictures of one size, the second shown to the right of a divider. Its range input is
  // the divider for keyboards and screen readers; a pointer may drag anywhere in the picture.
  for (const stage of document.querySelectorAll(".wipe")) {
    const input = stage.querySelector("input[type=range]");
    const show = () => {
      stage.style.setProperty("--split", `${input.value}%`);
      input.setAttribute("aria-valuetext", `${Math.round(input.value)} % from the left`);
    };
    brushexp.drag(stage, (x) => {
      input.focus({ preventScroll: true, focusVisible: false });
      input.value = 100 * x;
      show();
    });
    input.addEventListener("input", show);
    show();
  }

  // <button data-copy> copies the text of the <code> beside it, and confirms it.
  for (const button of document.querySelectorAll("[data-copy]")) {
    const code = button.parentElement.querySelector("code");
    const label = button.textContent;
    button.setAttribute("aria-live", "polite");
    button.addEventListener("click", async () => {
      const copied = await navigator.clipboard?.writeText(code.textContent).then(() => true, () => false);
      if (!copied) getSelection().selectAllChildren(code); // for browsers that deny the clipboard to local files
      button.textContent = copied ? "Copied" : "Press Ctrl+C";
      setTimeout(() => { button.textContent = label; }, 1600);
    });
  }
}
