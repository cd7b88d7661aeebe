"""Strokes that an engine has simulated: written as shards, read as batches."""
