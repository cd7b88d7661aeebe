"""Methods that recovery is compared with: a picture goes in; strokes come out."""
