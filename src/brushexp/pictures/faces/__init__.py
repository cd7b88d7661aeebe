"""Find faces with a small frozen network, and eyes of animals; loaded only when needed."""
