"""Report components that have no effect on a painting, and second stages with more steps than the first."""

import logging

from brushexp.painting.components import Components
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry.blame import name_member
from brushexp.strokes.catalogue import Strokes

log = logging.getLogger(__name__)


def log_idle_parts(parts: Components, strokes: Strokes, size: tuple[int, int]) -> None:
    """Log a warning for each component without effect, and for a second stage with more steps than the first.

    ``strokes`` are on a canvas of ``size`` (H, W).
    """
    steps = sum(stage.steps for stage in parts.stages)
    if steps and (reason := parts.density.idle_reason(steps)):
        log.warning("%s %s", name_member("density", parts.density), reason)
    is_whole = isinstance(parts.sampler, Whole)
    if steps and not is_whole and len(strokes) and parts.sampler.steps_per_round(strokes, size) == 1:
        told = "moves all %d strokes at each step, like sampler=whole; it pays off for more strokes and larger pictures"
        log.warning(f"%s {told}", name_member("sampler", parts.sampler), len(strokes))
    first, *others = parts.stages
    if others and others[-1].steps > first.steps:
        last = others[-1]
        told = "%d steps with renderer=%s and then %d with renderer=%s, %d in total; for fewer: finish_steps=%d"
        log.warning(told, first.steps, first.name, last.steps, last.name, steps, max(1, first.steps // 2))
