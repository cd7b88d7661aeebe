"""Families of paint, one per file, which are used for training and can be held out for a benchmark."""
