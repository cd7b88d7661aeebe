"""Regions go in; features come out from which their confidence is computed, and measures of how right it is."""
