"""Exporters: painting -> files. Pick several: ``task=export catalogue=catalogue.h5 to=svg,json``."""
