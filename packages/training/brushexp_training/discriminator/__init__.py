"""Train and use a network that distinguishes valid strokes from corrupted ones: ``loss=discriminator``."""
