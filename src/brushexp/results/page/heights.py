"""The height of the paint as a page takes it: a small map of 16 bits in a picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from brushexp.painting.outputs import export_job, renderer_of
from brushexp.registry import build_named
from brushexp.results.page.html import data_uri
from brushexp.shading.height import height_of
from brushexp.strokes.storage import Saved

MAP_SIDE = 512  # pixels: longer side of the map


def height_map(saved: Saved) -> dict[str, Any]:
    """What ``light.js`` needs: heights in pixels of the map are ``top`` * (256 red + green) / 65535.

    A renderer that is slow to draw is replaced by its stand-in, whose name is then in ``drawn_as``.

    Raises:
        UserError: if the renderer cannot be built, because its checkpoint is not there for instance.
    """
    renderer = renderer_of(saved)
    drawn_as = renderer.warm_up
    if drawn_as is not None:
        renderer = build_named("renderer", drawn_as, {})
    blend = build_named("blend", "tiled", {})
    job = export_job(saved, renderer, blend, saved.renderer, min(MAP_SIDE, max(saved.size)))
    height = height_of(job).clip(0)
    top = float(height.max()) or 1.0
    levels = (height / top * 65_535).round().astype(np.uint16)
    packed = np.stack([levels >> 8, levels & 255, np.zeros_like(levels)], axis=2).astype(np.uint8)
    source = data_uri(packed, compress_level=6)
    return {"source": source, "top": top, "width": saved.size[1], "height": saved.size[0], "drawn_as": drawn_as}
