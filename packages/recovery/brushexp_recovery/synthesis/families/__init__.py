"""Families of paint, a file each, which training learns from and which a benchmark can leave out."""
