"""Read marks drawn by people, find their regions, and compute the agreement of two sets of strokes."""
