"""Test numerical accuracy by drawing extreme scenes with every renderer, blend and precision."""
