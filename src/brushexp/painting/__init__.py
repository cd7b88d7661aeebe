"""Turn a target picture into a painting; the modules are listed below in the order of the data flow.

build (with working_size, changes, change, components, idle_parts, faces, init)
-> painting_module (with schedule, picture) -> other_painter (with painter), stroke_optimizer (with sampler,
canvas_memory, renderer, order, blend, loss, gradient_check, partial, optimizer, divergence, density, densification)
-> goals -> timelapse -> metrics -> finished -> reopen
"""
