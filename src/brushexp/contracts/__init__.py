"""The public interface for plugins, packages and your own programs.

All names here keep their meaning within a major version; the rest of ``brushexp`` may change. This module provides what
every plugin needs: registration, bounds for options, and the error that users see. Its submodules provide:

- `families`: the interface of each plugin family.
- `members`: shipped plugins that others extend.
- `strokes`: stroke representation: curves, catalogues, the prior, measures.
- `pictures`: reading and writing pictures; colour, structure, feature networks.
- `layers`: compositing and lighting of strokes.
- `networks`: layers for networks that draw strokes.
- `kernels`: compiled code, and the interface of rasterisers for other hardware.
- `painting`: the parts of a painting, its optimisation and its result.
- `tasks`: the keys of a task and rules between them.
- `runs`: output folders, the Trainer, resuming, sweeps, and the functions of ``brushexp``.
- `machine`: threads, memory and devices.
- `results`: tables of finished runs, and measures of their strokes.
- `pages`: HTML pages of runs and sweeps.
- `files`: safe reading and writing of files; progress display; text for terminals.
"""

from brushexp.bounds import (
    DURATION,
    FILE,
    FOLDER,
    INTERRUPTED_RUN,
    Bounds,
    Rule,
    above,
    at_least,
    between,
    multiple_of,
    one_of,
)
from brushexp.errors import UserError
from brushexp.registry import build, build_named, keep_built, plain_config, plugin_of, plugins, register, take_built

__all__ = [
    "DURATION",
    "FILE",
    "FOLDER",
    "INTERRUPTED_RUN",
    "Bounds",
    "Rule",
    "UserError",
    "above",
    "at_least",
    "between",
    "build",
    "build_named",
    "keep_built",
    "multiple_of",
    "one_of",
    "plain_config",
    "plugin_of",
    "plugins",
    "register",
    "take_built",
]
