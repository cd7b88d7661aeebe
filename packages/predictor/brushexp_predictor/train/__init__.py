"""Train the predictor through the renderer: from training pictures to weights."""
