// Show the pyramids beside this page with OpenSeadragon: the painting left of the curtain, another layer right of it,
// and strokes where the picture is enlarged.
"use strict";
{
  const LARGEST = 16; // screen pixels per pixel of the picture
  const DOUBLED = 2; // number of times that the brightness of differences, which are small, is doubled

  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("data").textContent);
  const [curtain, layer, strokes, scale] = ["curtain", "layer", "strokes", "scale"].map(byId);
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
  const [painting, ...layers] = data.names.map(source);
  const shapes = data.strokes && window.brushexp.stroke_tiles(data);
  const viewer = OpenSeadragon({
    id: "viewer",
    drawer: "canvas", // pictures from disk cannot be WebGL textures
    showNavigationControl: false,
    showNavigator: true,
    navigatorPosition: "BOTTOM_RIGHT",
    navigatorSizeRatio: 0.15,
    maxZoomPixelRatio: LARGEST / (shapes ? shapes.deeper : 1), // relative to the largest layer
    animationTime: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.6,
    tileSources: [painting, ...(shapes ? [shapes] : []), ...layers],
  });
  const item = (name) => viewer.world.getItemAt(name === data.names[0] ? 0 : data.names.indexOf(name) + (shapes ? 1 : 0));
  const whole = () => viewer.world.getItemAt(0);
  const zoom = () => whole().viewportToImageZoom(viewer.viewport.getZoom());
  const isNear = () => zoom() * devicePixelRatio >= 2 * shapes.finest;
  const isOpen = () => viewer.world.getItemCount() === data.names.length + (shapes ? 1 : 0);

  function draw_curtain() {
    if (!layer || !isOpen()) return;
    const bounds = viewer.viewport.getBounds();
    const edge = Math.max(0, whole().viewportToImageCoordinates(bounds.x + (bounds.width * curtain.value) / 100, 0).x);
    const shown = curtain.value < 100 && edge < data.width ? layer.value : null;
    const behind = item(shown === "difference" ? "target" : shown);
    for (const name of data.names.slice(1)) item(name).setOpacity(shown && item(name) === behind ? 1 : 0);
    if (!shown) return;
    behind.setCompositeOperation(shown === "difference" ? "difference" : null);
    behind.setClip(new OpenSeadragon.Rect(edge, 0, data.width - edge, data.height));
  }

  function brighten_difference() {
    if (layer?.value !== "difference" || curtain.value >= 100) return;
    const { canvas, context } = viewer.drawer;
    const left = Math.round((canvas.width * curtain.value) / 100);
    const place = [left, 0, canvas.width - left, canvas.height];
    if (!place[2]) return;
    context.save();
    context.resetTransform();
    context.globalCompositeOperation = "lighter";
    for (let i = 0; i < DOUBLED; i++) context.drawImage(canvas, ...place, ...place);
    context.restore();
  }

  function tell_scale(more = "") {
    scale.textContent = `${(100 * zoom()).toFixed(zoom() < 0.1 ? 1 : 0)} %${more}`;
  }

  async function describe_stroke(event) {
    if (!isOpen() || !strokes.checked || !isNear()) return;
    const { x, y } = whole().windowToImageCoordinates(new OpenSeadragon.Point(event.clientX, event.clientY));
    const stroke = await shapes.describe(x, y, 1 / zoom());
    tell_scale(stroke ? ` · ${stroke.width.toFixed(1)} px wide, ${Math.round(100 * stroke.opacity)} % ${stroke.color}` : "");
  }

  const zooms = {
    in: () => viewer.viewport.zoomBy(1.5),
    out: () => viewer.viewport.zoomBy(1 / 1.5),
    whole: () => viewer.viewport.goHome(),
    one: () => viewer.viewport.zoomTo(whole().imageToViewportZoom(1)),
    full: () => viewer.setFullScreen(!viewer.isFullPage()),
  };
  for (const button of document.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => {
      zooms[button.dataset.zoom]();
      viewer.viewport.applyConstraints();
    });
  }
  // A visible image without tiles at this zoom would be redrawn in every frame.
  const show_strokes = () => viewer.world.getItemAt(1)?.setOpacity(strokes.checked && isNear() ? 1 : 0);
  for (const one of [curtain, layer]) one?.addEventListener("input", draw_curtain);
  strokes?.addEventListener("input", show_strokes);
  if (strokes) byId("viewer").addEventListener("pointermove", describe_stroke);
  const small = viewer.navigator.world;
  small.addHandler("add-item", ({ item: one }) => { if (one.source.deeper) small.removeItem(one); });
  viewer.addHandler("update-viewport", brighten_difference);
  viewer.addHandler("open", () => {
    viewer.viewport.goHome(true);
    draw_curtain();
    if (!shapes) return;
    viewer.world.getItemAt(1).minPixelRatio = shapes.finest;
    show_strokes();
  });
  viewer.addHandler("viewport-change", () => {
    draw_curtain();
    if (shapes) show_strokes();
    tell_scale();
  });
}
