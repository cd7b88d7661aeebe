"""Train renderers on simulated strokes; the parts are listed in the order of the data flow.

schema (with rules, functions, tasks) -> engine -> stroke_sets -> fitting (with renderers, discriminator) -> evaluation
"""
