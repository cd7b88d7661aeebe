"""Paint films frame by frame, carrying strokes over from one frame to the next."""
