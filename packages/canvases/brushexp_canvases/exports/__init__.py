"""Exporters of pyramids, as members of the family ``to``."""
