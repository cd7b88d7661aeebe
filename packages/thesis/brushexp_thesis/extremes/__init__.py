"""Test numerical accuracy: draw extreme scenes with each component of the program, and assess the results."""
