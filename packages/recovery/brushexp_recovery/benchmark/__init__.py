"""Score the strokes that any method finds in paintings with known strokes, and report the scores."""
