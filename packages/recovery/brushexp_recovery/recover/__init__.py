"""Recover the strokes of a pictured painting as a catalogue with confidences and visible regions."""
