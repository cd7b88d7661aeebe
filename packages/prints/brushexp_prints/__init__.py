"""Exporters for mail, print, film and relief, as members of the family ``to``."""

from brushexp_prints import gltf, jpg, ora, pdf, process, psd, relief

__all__ = ["gltf", "jpg", "ora", "pdf", "process", "psd", "relief"]
