"""Paint pictures too large for memory, tile by tile on a canvas on disk, with the workers of a Dask cluster."""
