"""Pictures of every kind -> tensors: decoding, colour, size. Nothing here knows of strokes."""
