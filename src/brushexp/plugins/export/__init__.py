"""Exporters write a painting to files; choose several with ``task=export catalogue=catalogue.h5 to=svg,json``."""
