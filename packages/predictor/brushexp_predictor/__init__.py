"""Place a picture's strokes with a network in a few passes, without gradient steps."""
