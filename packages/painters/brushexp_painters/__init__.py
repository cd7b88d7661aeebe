"""Painters that others have published, as members of the family ``painter``."""

from brushexp_painters import evolution, gatys, greedy, haeberli, hertzmann, kotovenko, litwinowicz, zou

__all__ = ["evolution", "gatys", "greedy", "haeberli", "hertzmann", "kotovenko", "litwinowicz", "zou"]
