"""Changes: what is different about one painting. Choose any number: ``'change=[wet,guides]'``."""
