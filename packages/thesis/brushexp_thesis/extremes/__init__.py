"""Test numerical accuracy: extreme scenes, and a verdict on how each part of the program draws them."""
