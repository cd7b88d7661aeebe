"""Train and apply a network that distinguishes valid strokes from corrupted strokes: ``loss=discriminator``."""
