"""Callbacks act between the steps of a fit; choose several with ``callbacks=[timer,learning_rate_monitor]``."""
