"""Shipped configs; `brushexp.config.schema` declares the keys of tasks, and users put their own configs in ``conf``."""
