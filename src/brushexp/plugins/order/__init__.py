"""Orders: which stroke lies on top. Pick one: ``order=area``."""
