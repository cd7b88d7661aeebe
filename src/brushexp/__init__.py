"""Paint pictures out of brush strokes by gradient descent, and study how well that works."""

from brushexp.system.runtime import keep_memory, let_threads_sleep

let_threads_sleep()
keep_memory()
