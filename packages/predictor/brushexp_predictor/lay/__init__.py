"""From a picture to strokes: network, decoding of its output, levels from large cells to small, and best colours."""
