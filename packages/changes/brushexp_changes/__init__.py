"""Changes to a painting: guides, one region, a table's tubes and brushes, stroke sizes, wet paint, random grounds."""
