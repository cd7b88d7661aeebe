"""Changes to a painting: guides, region, tubes and brushes, stroke sizes, wet paint and random grounds."""
