"""Convert picture files of many formats to tensors: decoding, colour and size; nothing here depends on strokes."""
