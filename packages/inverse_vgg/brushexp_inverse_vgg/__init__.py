"""The thesis's network as a renderer, and ``task=prune``, which makes a trained one smaller."""
