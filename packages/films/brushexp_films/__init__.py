"""Paint films picture by picture, carrying strokes from one picture to the next."""
