"""Brush simulators turn stroke parameters into a picture of one stroke; choose one with ``engine=...``."""
