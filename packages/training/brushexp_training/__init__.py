"""Train renderers on simulated strokes.

The modules, in the order in which data flows through them, are:
schema (with rules, functions, tasks) -> engine -> stroke_sets -> fitting (with renderers, discriminator) -> evaluation
"""
