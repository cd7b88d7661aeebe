"""From a target picture to a painting, in the order of the data.

assembly (with init) -> components
-> painter (with rehearsal, schedule, conversion, pyramid, sampler, picture, canvas_memory, patch_cache, renderer,
order, depth, blend, loss, partial, optimizer, density, densification, importance, curves, painter_state)
-> anytime -> goals -> timelapse -> metrics -> outputs
"""
