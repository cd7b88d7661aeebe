"""Papers and canvases have a relief, and parts that paint skips; choose one with ``paper=cold_pressed``."""
