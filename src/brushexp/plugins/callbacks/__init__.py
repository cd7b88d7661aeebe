"""Callbacks: actions during a fit, beside its steps. Choose any number: ``callbacks=[timer,learning_rate_monitor]``."""
