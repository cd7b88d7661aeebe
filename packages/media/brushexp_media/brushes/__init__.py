"""Use your own brushes, scanned strokes or GIMP's brushes, as ``renderer=brush`` or ``brush=stroke.png``."""
