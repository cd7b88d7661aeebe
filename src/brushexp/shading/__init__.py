"""The painting as an object: strokes -> height of the paint (`height`) -> what a lamp shows of it (`light`)."""
