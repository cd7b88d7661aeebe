"""Predict a picture's strokes: the network, decoding of its output, levels from large to small cells, and colours."""
