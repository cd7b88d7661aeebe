"""Changes to a painting: guides, one region, given tubes and brushes, stroke sizes, wet paint, random grounds."""
