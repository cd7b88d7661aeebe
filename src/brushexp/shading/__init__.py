"""Treat a painting as a physical surface: compute the height of its paint (`height`) and light it (`light`)."""
