"""Turn picture files of all kinds into tensors: decoding, colour, size. Nothing here depends on strokes."""
