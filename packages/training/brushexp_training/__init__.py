"""Turn simulated strokes into a trained renderer; the parts in the order of the data.

schema (with rules, functions, tasks) -> engine -> stroke_sets -> fitting (with renderers, discriminator) -> evaluation
"""
