"""Paint with given tubes and brushes (``tubes=``), write plans for painting by hand, and measure colour differences."""
