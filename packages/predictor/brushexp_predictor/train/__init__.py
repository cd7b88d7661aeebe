"""Train the predictor through the renderer."""
