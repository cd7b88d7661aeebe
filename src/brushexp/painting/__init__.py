"""From a target picture to a painting, in the order of the data.

assembly (with init) -> components -> preparation
-> painting_module (with schedule, picture, curves)
-> procedure, painter (with canvas_memory, sampler, renderer, order, blend, loss, divergence, partial, optimizer,
density, densification, painter_state)
-> goals -> wet -> timelapse -> metrics -> finished
"""
