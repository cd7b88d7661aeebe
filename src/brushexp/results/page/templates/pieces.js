// What pieces.html.j2 needs, for all that is in the page when it is loaded; brushexp.drag, whenSeen and fit are for other
// scripts too.
"use strict";
{
  const brushexp = (window.brushexp ??= {});

  // Call follow(x, y) with places in an element, 0 to 1, while a pointer is held down in it.
  brushexp.drag = (element, follow, begin = () => {}) => {
    const at = (event) => {
      const box = element.getBoundingClientRect();
      follow((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    };
    element.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      event.preventDefault(); // no selection, no dragging of the picture
      element.setPointerCapture(event.pointerId);
      begin();
      at(event);
    });
    element.addEventListener("pointermove", (event) => { if (element.hasPointerCapture(event.pointerId)) at(event); });
  };

  // Call load() once, when an element is nearly in view.
  brushexp.whenSeen = (element, load) =>
    new IntersectionObserver((entries, observer) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      load();
    }, { rootMargin: "300px" }).observe(element);

  // <img data-of="#id"> shows the same picture as another image, so that it is in the file once.
  for (const image of document.querySelectorAll("img[data-of]")) image.src = document.querySelector(image.dataset.of).src;

  // A .stage, or what is as wide as one, gets the shape of its picture.
  brushexp.fit = (stage) => stage.style.setProperty("--ratio", stage.dataset.width / stage.dataset.height);
  document.querySelectorAll("[data-width]").forEach(brushexp.fit);

  // <div class="stage wipe">: two pictures of one size, the second one shown to the right of a divider. The range input in
  // it is the divider for keyboards and screen readers; a pointer may drag anywhere in the picture.
  for (const stage of document.querySelectorAll(".wipe")) {
    const input = stage.querySelector("input[type=range]");
    const show = () => {
      stage.style.setProperty("--split", `${input.value}%`);
      input.setAttribute("aria-valuetext", `${Math.round(input.value)} % from the left`);
    };
    brushexp.drag(stage, (x) => {
      input.value = 100 * x;
      show();
    }, () => input.focus({ preventScroll: true, focusVisible: false }));
    input.addEventListener("input", show);
    show();
  }

  // <button data-copy>: copies the text of the <code> beside it, and says so.
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
}
