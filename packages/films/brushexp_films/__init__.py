"""Paint films picture by picture, carrying strokes over from one picture to the next."""
