"""Merge superpixels into a tree of regions, and find its best cut into strokes."""
