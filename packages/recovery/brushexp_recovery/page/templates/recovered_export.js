// Export the shown strokes: CSV with units, GeoJSON (y upwards, as in maps), SVG for drawing programs.
"use strict";
{
  const { recovered } = window.brushexp;
  const { data, shown, colorOf, inUnit, unitOf } = recovered;
  const { names, columns, outlines, colors, width, height, mm, name } = data;
  const PIXELS = ["x", "y", "seen"]; // these columns are always in pixels

  const short = (value) => Number(value.toPrecision(6));
  const headOf = (key) => {
    const unit = key === "direction" ? "deg clockwise" : PIXELS.includes(key) ? "px" : unitOf(key).replace("²", "^2").replace("°", "deg");
    return unit ? `${key} [${unit}]` : key;
  };
  const valuesOf = (k) => names.map((key) => [headOf(key), short(inUnit(key, columns[key][k]))]).concat([["color", colors[k]]]);

  const csv = () => {
    const rows = shown().map((k) => valuesOf(k).map(([, value]) => value).join(","));
    return [[...names.map(headOf), "color"].join(","), ...rows, ""].join("\n");
  };
  const geojson = () => {
    const unit = mm ?? 1;
    const features = shown().map((k) => ({
      type: "Feature",
      properties: Object.fromEntries(valuesOf(k)),
      geometry: { type: "Polygon", coordinates: [[...outlines[k], outlines[k][0]].map(([x, y]) => [short(unit * x), short(-unit * y)])] },
    }));
    return JSON.stringify({ type: "FeatureCollection", name, unit: mm ? "mm" : "px", features });
  };
  const svg = () => {
    const lines = shown().map((k) => `<polygon id="stroke-${columns.stroke[k]}" points="${outlines[k].map((point) => point.join(",")).join(" ")}" stroke="${colorOf(k)}"/>`);
    const size = mm ? `width="${short(mm * width)}mm" height="${short(mm * height)}mm"` : `width="${width}px" height="${height}px"`;
    return `<svg xmlns="http://www.w3.org/2000/svg" ${size} viewBox="0 0 ${width} ${height}" fill="none" stroke-linejoin="round">\n${lines.join("\n")}\n</svg>\n`;
  };

  const kinds = { csv: [csv, "text/csv"], geojson: [geojson, "application/geo+json"], svg: [svg, "image/svg+xml"] };
  for (const button of document.querySelectorAll("[data-export]"))
    button.addEventListener("click", () => {
      const [write, type] = kinds[button.dataset.export];
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([write()], { type }));
      link.download = `strokes.${button.dataset.export}`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
}
