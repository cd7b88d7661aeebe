"""Predict the strokes of a picture: the network, its decoded output, levels from large to small cells, and colours."""
