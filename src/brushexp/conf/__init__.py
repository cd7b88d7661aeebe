"""Configs that ship; a task's keys are in `brushexp.config.schema`, and those of users in ``conf`` of their folder."""
