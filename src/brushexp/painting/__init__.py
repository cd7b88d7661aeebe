"""From a target picture to a painting, in the order of the data.

assembly (with init) -> components
-> painter (with pyramid, sampler, canvas_memory, patch_cache, renderer, order, blend, loss, partial,
optimizer, density, importance)
-> anytime -> cost -> goals -> progress -> timelapse -> metrics -> outputs
"""
