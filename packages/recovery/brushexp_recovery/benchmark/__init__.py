"""Score the strokes that a method finds in paintings with known strokes, and report the scores."""
