"""Recover the strokes of a painting from its picture as a catalogue with confidences and visible regions."""
