"""Recover the strokes of a painting from a picture, as a catalogue with confidences and visible regions."""
