"""Paint pictures too large for memory, tile by tile, on a canvas on disk and the workers of a Dask cluster."""
