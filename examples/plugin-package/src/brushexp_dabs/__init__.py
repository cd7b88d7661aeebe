"""Dry-brush engine for brushexp: ``engine=dabs``."""
