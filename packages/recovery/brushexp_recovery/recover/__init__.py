"""A picture of a painting goes in; its strokes come out, as a catalogue with confidences and visible regions."""
