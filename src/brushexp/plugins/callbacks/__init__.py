"""Callbacks: what happens beside the steps of a fit. Pick any number: ``callbacks=[timer,learning_rate_monitor]``."""
