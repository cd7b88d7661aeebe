"""Films are painted picture by picture, and strokes are carried from one picture to the next."""
