"""Use private parts of other libraries; each module states the versions with which it was tested."""
