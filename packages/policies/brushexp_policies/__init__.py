"""Which strokes a step moves and a pixel shows, how they lie, when they come and go: rules that no default needs."""
