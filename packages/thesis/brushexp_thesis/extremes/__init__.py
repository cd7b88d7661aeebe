"""Test numerical accuracy: draw extreme scenes with each part of the program, and judge the results."""
