"""Orders: which stroke lies on top. Choose one: ``order=area``."""
