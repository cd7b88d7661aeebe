"""Changes modify how a painting is made; choose several with ``'change=[wet,guides]'``."""
