"""Papers and canvases, and the behaviour of wet paint on them."""
