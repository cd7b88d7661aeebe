"""Exporters for print, film and relief, as members of the family ``to``."""

from brushexp_prints import pdf, process, relief

__all__ = ["pdf", "process", "relief"]
