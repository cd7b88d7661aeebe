"""The painting as an object: strokes -> height of the paint (`height`) -> its appearance under a lamp (`light`)."""
