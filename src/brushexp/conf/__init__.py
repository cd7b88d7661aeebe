"""Shipped configs; `brushexp.config.schema` declares the keys of tasks, and users keep their own in ``conf``."""
