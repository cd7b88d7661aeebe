"""One region of a painting is repainted: ``region=mask.png``."""
