"""Merge superpixels into a tree of regions, and find the best cut of the tree into strokes."""
