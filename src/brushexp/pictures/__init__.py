"""Turn picture files of all formats into tensors: decoding, colour and size. Nothing here depends on strokes."""
