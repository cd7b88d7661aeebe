"""Orders decide which strokes are on top of others; choose one with ``order=area``."""
