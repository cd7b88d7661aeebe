"""Papers and canvases, which have a relief and show through gaps in the paint; choose with ``paper=cold_pressed``."""
