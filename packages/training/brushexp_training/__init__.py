"""Turn simulated strokes into a trained renderer; the modules in the order of the data.

schema (with rules, functions) -> engine -> writer -> dataset -> datamodule (with stroke_data)
-> renderer_module (with network_module, renderer, neural) -> network_fitting
-> evaluation -> benchmark -> stroke_sheets
"""
