"""Your own brushes: scanned strokes and the brushes of GIMP, as ``renderer=brush`` and ``brush=stroke.png``."""
