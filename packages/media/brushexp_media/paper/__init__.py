"""Papers and canvases, and what wet paint does on them."""
