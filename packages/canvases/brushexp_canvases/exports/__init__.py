"""Exporters of pyramids, as members of the family ``to``."""

from brushexp_canvases.exports import dzi, iiif, zarr

__all__ = ["dzi", "iiif", "zarr"]
