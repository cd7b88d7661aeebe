// <div class="stage wipe">: two pictures of one size, the second one shown to the right of a divider. The range input in
// it is the divider for keyboards and screen readers; a pointer may drag anywhere in the picture.
// brushexp.fit(stage) gives a .stage (or what is around it, a .sized) the shape of data-width x data-height; brushexp.wipe(element) brings one to life
// that was made later. Both are done for all that are in the page. <img data-of="#id"> shows the same picture as another
// image, so that it is in the file once.
"use strict";
{
  const brushexp = (window.brushexp ??= {});

  brushexp.fit = (stage) => {
    const { width, height } = stage.dataset;
    if (width > 0 && height > 0) stage.style.setProperty("--ratio", width / height);
  };

  brushexp.wipe = (element) => {
    const input = element.querySelector("input[type=range]");
    const show = () => {
      element.style.setProperty("--split", `${input.value}%`);
      input.setAttribute("aria-valuetext", `${Math.round(input.value)} % from the left`);
    };
    const follow = (event) => {
      const box = element.getBoundingClientRect();
      input.value = (100 * (event.clientX - box.left)) / box.width;
      show();
    };
    element.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      event.preventDefault(); // no selection, no dragging of the picture
      element.setPointerCapture(event.pointerId);
      input.focus({ preventScroll: true, focusVisible: false });
      follow(event);
    });
    element.addEventListener("pointermove", (event) => {
      if (element.hasPointerCapture(event.pointerId)) follow(event);
    });
    input.addEventListener("input", show);
    show();
  };

  for (const image of document.querySelectorAll("img[data-of]")) image.src = document.querySelector(image.dataset.of).src;
  document.querySelectorAll("[data-width]").forEach(brushexp.fit);
  document.querySelectorAll(".wipe").forEach(brushexp.wipe);
}
