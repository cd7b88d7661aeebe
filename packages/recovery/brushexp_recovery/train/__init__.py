"""Paintings with known strokes go in; a trained `RecoveryModel` comes out."""
