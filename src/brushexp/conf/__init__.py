"""Configs that ship; `brushexp.config.schema` declares the keys of tasks, and users keep their configs in ``conf``."""
