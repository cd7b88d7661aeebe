"""Let strokes drag the wet paint beneath them: ``wet=0.5``."""
