"""Read marks drawn by people, find their regions, and compare them with strokes."""
