"""Neural renderers, and their pruning."""
