"""Paint with given tubes and brushes (``tubes=``), plan painting by hand, and measure colour differences."""
