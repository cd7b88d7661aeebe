"""Make strokes follow hand-drawn lines: ``guides=lines.png``."""
