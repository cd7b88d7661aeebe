"""Changes of a painting: guides, one region, tubes and brushes of a table, sizes of strokes, wet paint, grounds."""
