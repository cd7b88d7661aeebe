"""Neural renderers, and code that prunes them."""
