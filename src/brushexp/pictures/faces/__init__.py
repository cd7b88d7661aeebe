"""Faces in pictures, found by a small frozen network, and eyes of animals. Loaded only when something asks for them."""
