"""Exporters: painting -> files. Choose any number: ``task=export catalogue=catalogue.h5 to=svg,json``."""
