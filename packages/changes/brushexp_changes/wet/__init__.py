"""Strokes drag along the wet paint that lies under them: ``wet=0.5``."""
