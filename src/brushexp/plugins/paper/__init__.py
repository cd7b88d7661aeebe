"""Papers and canvases: their relief, and the parts that paint skips. Choose one: ``paper=cold_pressed``."""
