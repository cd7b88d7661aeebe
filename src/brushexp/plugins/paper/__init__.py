"""Papers and canvases: which of it paint skips, and its relief. Pick one: ``paper=cold_pressed``."""
