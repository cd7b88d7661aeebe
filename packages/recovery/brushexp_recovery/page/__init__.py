"""A table of recovered strokes goes in; a page that shows them on the photograph comes out."""
