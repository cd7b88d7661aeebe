"""Write HTML pages that show recovered strokes on the photograph."""
