"""Blur, resample, tile, compare and store pictures, label images and maps as arrays; nothing here concerns strokes."""
