"""From a target picture to a painting, in the order of the data.

assembly (with init) -> parts
-> painter (with aim, sampler, view, kept, renderer, order, blend, loss, partial, optimizer, density, worth)
-> anytime -> cost -> goals -> progress -> timelapse -> metrics -> outputs
"""
