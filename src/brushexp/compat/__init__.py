"""Use private parts of other libraries; each module states the version it was tested with."""
