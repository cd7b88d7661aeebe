"""Find faces and the eyes of animals, using a small frozen network that is loaded on demand."""
