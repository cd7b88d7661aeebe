"""Papers and canvases: their relief, and the parts that paint skips. Pick one: ``paper=cold_pressed``."""
