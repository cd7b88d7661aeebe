"""From simulated strokes to a trained renderer, in the order of the data.

engine -> writer -> dataset -> datamodule -> trainer (with renderer, adversarial, sheets, progress) -> evaluation
-> benchmark -> pruning, corruption -> discriminator -> loss
"""
