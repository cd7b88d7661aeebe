"""A picture -> strokes: the network, what it says as strokes, from large cells to small ones, in their best colours."""
