"""From a target picture to a painting, in the order of the data.

assembly (with init) -> components -> preparation
-> painting_module (a procedure with painter, or) painter (with schedule, picture, canvas_memory, sampler, renderer, order, blend, loss, divergence, partial,
optimizer, density, densification, curves, painter_state)
-> goals -> wet -> timelapse -> metrics -> outputs -> finished
-> reel (with changes, carrying)
"""
