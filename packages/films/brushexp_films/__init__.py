"""Films painted picture by picture, their strokes carried from one to the next."""
