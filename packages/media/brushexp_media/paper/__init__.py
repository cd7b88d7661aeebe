"""Papers and canvases, and the way wet paint behaves on them."""
