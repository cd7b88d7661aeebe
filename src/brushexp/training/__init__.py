"""From simulated strokes to a trained renderer, in the order of the data.

engine -> recording -> dataset -> stream -> trainer (with renderer, adversarial, progress) -> evaluation -> judging
-> pruning, spoiling -> discriminator -> loss
"""
