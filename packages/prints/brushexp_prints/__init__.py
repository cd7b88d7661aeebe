"""Exporters for mail, print, film and relief, as members of the family ``to``."""

from brushexp_prints import jpg, ora, pdf, process, psd, relief

__all__ = ["jpg", "ora", "pdf", "process", "psd", "relief"]
