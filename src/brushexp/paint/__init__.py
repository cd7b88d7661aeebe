"""From a target picture to a painting, in the order of the data.

decode -> target -> init -> painter (with sampler, renderer, order, blend, loss, optimizer, density)
-> progress -> timelapse -> metrics -> outputs
"""
