"""Use private parts of other libraries; each module names the version it was tested with."""
