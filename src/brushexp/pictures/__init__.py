"""Convert picture files of all formats to tensors: decoding, colour and size; nothing here depends on strokes."""
