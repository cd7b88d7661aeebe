"""Train renderers on simulated strokes; the modules below are listed in the order of the data flow.

schema (with rules, functions, tasks) -> engine -> stroke_sets -> fitting (with renderers, discriminator) -> evaluation
"""
