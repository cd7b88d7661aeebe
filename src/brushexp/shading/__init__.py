"""The painting as an object: strokes -> height of the paint (`height`) -> how it looks under a light (`light`)."""
