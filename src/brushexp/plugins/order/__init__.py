"""Orders decide which stroke lies on top; choose one with ``order=area``."""
