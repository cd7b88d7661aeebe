"""Paint with your own brushes, from scanned strokes or brush files, with ``renderer=brush`` or ``brush=stroke.png``."""
