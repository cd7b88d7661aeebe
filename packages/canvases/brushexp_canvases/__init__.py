"""Canvases on disk: pictures too large for memory, painted tile by tile on the workers of a Dask cluster."""
