"""Exporters: what leaves the program. Pick several: ``task=export catalogue=catalogue.h5 to=svg,json``."""
