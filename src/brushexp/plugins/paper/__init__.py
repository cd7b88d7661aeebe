"""Papers and canvases have a relief and areas that the paint skips; choose one with ``paper=cold_pressed``."""
