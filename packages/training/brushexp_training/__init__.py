"""Train renderers on simulated strokes; the parts are in the order of the data.

schema (with rules, functions, tasks) -> engine -> stroke_sets -> fitting (with renderers, discriminator) -> evaluation
"""
