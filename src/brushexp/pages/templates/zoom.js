// <button data-zoom="#painting"> shows that picture alone, fitted to the window. A click, + and -, or Ctrl with the
// wheel zoom; dragging moves the picture, Esc returns to the page.
"use strict";
{
  const STEP = 1.5, LARGEST = 16; // relative to the fitted size
  const dialog = document.createElement("dialog");
  dialog.className = "alone";
  dialog.setAttribute("aria-label", "The picture alone");
  dialog.innerHTML = `<div class="row alone-bar">
    <button class="button" type="button" data-size="-1" aria-label="Smaller">−</button>
    <button class="button" type="button" data-size="1" aria-label="Larger">+</button>
    <button class="button" type="button" data-size="0">Fit</button><output aria-live="polite"></output>
    <button class="button" type="button" data-size="">Close</button></div>
    <div class="alone-field" tabindex="0" role="group" aria-label="The painting alone: scroll or drag to move it"><img alt="" draggable="false"></div>`;
  const [field, image, said] = [".alone-field", "img", "output"].map((part) => dialog.querySelector(part));
  let size = 1;

  const fitted = () =>
    Math.min(field.clientWidth, (field.clientHeight * image.naturalWidth) / Math.max(image.naturalHeight, 1));

  // Zoom the picture to `larger` times its fitted size around the point x, y of the window.
  const resize = (larger, x = innerWidth / 2, y = innerHeight / 2) => {
    const box = image.getBoundingClientRect();
    const [across, down] = [(x - box.left) / (box.width || 1), (y - box.top) / (box.height || 1)];
    size = Math.min(LARGEST, Math.max(1, larger));
    image.style.width = `${fitted() * size}px`;
    const now = image.getBoundingClientRect();
    field.scrollLeft += now.left + across * now.width - x;
    field.scrollTop += now.top + down * now.height - y;
    said.textContent = `${Math.round((100 * now.width) / (image.naturalWidth || 1))} %`;
  };

  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("[data-zoom]");
    const shown = button && document.querySelector(button.dataset.zoom);
    if (!shown) return;
    image.src = shown.currentSrc || shown.src;
    image.alt = shown.alt;
    if (!dialog.isConnected) document.body.append(dialog);
    dialog.showModal();
    image.decode().catch(() => {}).then(() => resize(1));
  });
  dialog.addEventListener("click", ({ target }) => {
    const { size: change } = target.closest("[data-size]")?.dataset ?? {};
    if (change === "" || target === dialog) dialog.close();
    else if (change) resize(change === "0" ? 1 : size * STEP ** change);
  });
  dialog.addEventListener("keydown", ({ key }) => {
    if (key === "+" || key === "=") resize(size * STEP);
    if (key === "-") resize(size / STEP);
    if (key === "0") resize(1);
  });
  field.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    resize(size * (event.deltaY < 0 ? STEP : 1 / STEP), event.clientX, event.clientY);
  }, { passive: false });

  let moved = 0; // pixels moved since the pointer went down
  field.addEventListener("pointerdown", () => { moved = 0; });
  field.addEventListener("pointermove", (event) => {
    if (!(event.buttons & 1) || event.pointerType !== "mouse") return; // a finger scrolls by itself
    moved += Math.abs(event.movementX) + Math.abs(event.movementY);
    field.scrollBy(-event.movementX, -event.movementY);
  });
  image.addEventListener("click", (event) => {
    if (moved < 4) resize(size > 1 ? 1 : 3, event.clientX, event.clientY);
  });
  addEventListener("resize", () => { if (dialog.open) resize(size); });
}
