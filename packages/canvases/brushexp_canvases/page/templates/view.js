// Show the pyramids beside this page with OpenSeadragon, the painting left of the curtain and the target right of it.
"use strict";
{
  const data = JSON.parse(document.getElementById("data").textContent);
  const source = (name) => ({
    Image: {
      xmlns: "http://schemas.microsoft.com/deepzoom/2008",
      Url: `${name}_files/`,
      Format: "jpg",
      Overlap: "0",
      TileSize: String(data.tile),
      Size: { Width: String(data.width), Height: String(data.height) },
    },
  });
  const viewer = OpenSeadragon({
    id: "viewer",
    drawer: "canvas", // pictures from disk cannot be textures
    showNavigationControl: false,
    showNavigator: true,
    navigatorPosition: "BOTTOM_RIGHT",
    navigatorSizeRatio: 0.15,
    maxZoomPixelRatio: 8,
    animationTime: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.6,
    tileSources: data.names.map(source),
  });
  const curtain = document.getElementById("curtain");
  const scale = document.getElementById("scale");

  function draw_curtain() {
    const target = viewer.world.getItemAt(1);
    if (!target) return;
    const bounds = viewer.viewport.viewportToImageRectangle(viewer.viewport.getBounds());
    const edge = Math.min(data.width, Math.max(0, bounds.x + (bounds.width * curtain.value) / 100));
    const is_shown = curtain.value < 100 && edge < data.width;
    target.setOpacity(is_shown ? 1 : 0);
    if (is_shown) target.setClip(new OpenSeadragon.Rect(edge, 0, data.width - edge, data.height));
  }

  function tell_scale() {
    const zoom = viewer.viewport.viewportToImageZoom(viewer.viewport.getZoom());
    scale.textContent = `${(100 * zoom).toFixed(zoom < 0.1 ? 1 : 0)} %`;
  }

  const zooms = {
    in: () => viewer.viewport.zoomBy(1.5),
    out: () => viewer.viewport.zoomBy(1 / 1.5),
    whole: () => viewer.viewport.goHome(),
    one: () => viewer.viewport.zoomTo(viewer.viewport.imageToViewportZoom(1)),
    full: () => viewer.setFullScreen(!viewer.isFullPage()),
  };
  for (const button of document.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => {
      zooms[button.dataset.zoom]();
      viewer.viewport.applyConstraints();
    });
  }
  curtain.addEventListener("input", draw_curtain);
  viewer.addHandler("open", () => {
    viewer.viewport.goHome(true);
    draw_curtain();
  });
  viewer.addHandler("viewport-change", () => {
    draw_curtain();
    tell_scale();
  });
}
