"""Blur, resample, tile, compare and store pictures, label images and maps as arrays, independently of strokes."""
