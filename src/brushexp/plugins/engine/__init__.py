"""Brush simulators paint a single stroke from its parameters; choose one with ``engine=...``."""
