"""Train renderers on simulated strokes; the list below gives the modules in the order in which data flows through them.

schema (with rules, functions, tasks) -> engine -> stroke_sets -> fitting (with renderers, discriminator) -> evaluation
"""
