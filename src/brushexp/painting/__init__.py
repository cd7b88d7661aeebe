"""Turn a target picture into a painting; the modules below are listed in the order in which data flow through them.

build (with working_size, changes, change, components, idle_parts, faces, init)
-> painting_module (with schedule, picture) -> other_painter (with painter), stroke_optimizer (with sampler,
canvas_memory, renderer, order, blend, loss, gradient_check, partial, optimizer, divergence, density, densification)
-> goals -> timelapse -> metrics -> finished -> reopen
"""
