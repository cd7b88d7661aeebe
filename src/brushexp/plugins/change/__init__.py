"""Changes make one painting differ from others; choose several with ``'change=[wet,guides]'``."""
