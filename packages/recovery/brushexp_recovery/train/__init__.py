"""Train a `RecoveryModel` on paintings with known strokes."""
