"""From simulated strokes to a trained renderer, in the order of the data.

engine -> writer -> dataset -> datamodule (with stroke_data)
-> renderer_module (with network_module, renderer) -> evaluation -> benchmark
"""
