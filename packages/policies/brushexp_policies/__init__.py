"""Optional samplers, blends, orders and density policies."""
