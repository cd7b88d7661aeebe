"""Configs that ship; `brushexp.config.schema` has the keys of tasks, and users' configs go in their own ``conf``."""
