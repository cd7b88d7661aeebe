"""Write pages that show recovered strokes on the photograph."""
