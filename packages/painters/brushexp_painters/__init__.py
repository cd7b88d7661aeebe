"""Painters that others have published, as members of the family ``painter``."""
