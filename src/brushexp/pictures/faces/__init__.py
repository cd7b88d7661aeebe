"""Find faces, and eyes of animals, with a small frozen network that is loaded on demand."""
