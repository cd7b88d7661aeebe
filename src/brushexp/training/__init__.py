"""From simulated strokes to a trained renderer, in the order of the data.

engine -> writer -> dataset -> datamodule -> renderer_module (with network_module, fresh_start, renderer) -> evaluation
-> benchmark -> pruning, corruption -> discriminator_module -> loss
"""
