"""A dry brush for brushexp: ``engine=dabs``."""
