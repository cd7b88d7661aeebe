"""Families of paint, one per file, which are used in training and can be held out for a benchmark."""
