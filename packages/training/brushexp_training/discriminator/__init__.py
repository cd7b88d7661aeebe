"""A network that tells valid strokes from corrupted ones, for ``loss=discriminator``."""
