"""The painting as a physical surface: strokes -> height of the paint (`height`) -> its look under a lamp (`light`)."""
