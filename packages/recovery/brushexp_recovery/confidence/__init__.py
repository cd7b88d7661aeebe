"""Regions go in; features come out, from which a confidence is computed. Calibration tells how right it is."""
