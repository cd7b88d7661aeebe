"""From a target picture to a painting, in the order of the data.

assembly (with init) -> parts
-> painter (with sampler, view, kept, renderer, order, blend, loss, partial, optimizer, density)
-> bands -> progress -> timelapse -> metrics -> outputs
"""
