"""Changes: what is different about one painting. Pick several: ``'change=[wet,guides]'``."""
