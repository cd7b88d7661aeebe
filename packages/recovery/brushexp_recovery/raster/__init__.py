"""Blur, resample, tile, compare and store pictures, label images and maps, without reference to strokes."""
