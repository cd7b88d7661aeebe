"""The public interface for plugins, packages and your own programs.

Everything here keeps its name and meaning within a major version; the rest of ``brushexp`` may change. This module
provides what every plugin needs: registration, bounds of options, and the error that users see. Its submodules provide:

- `families`: the contract of each family of plugins.
- `members`: shipped plugins that others extend.
- `strokes`: the representation of strokes: curves, catalogues, the prior, measures.
- `pictures`: reading and writing pictures, colour, structure, feature networks.
- `layers`: compositing of strokes, and the light on them.
- `networks`: layers for networks that draw strokes.
- `kernels`: compiled code, and the interface of rasterisers for other hardware.
- `painting`: the parts of a painting, its optimisation and its result.
- `tasks`: keys and rules of a task.
- `runs`: output folders, the Trainer, resuming, sweeps, and the functions of ``brushexp``.
- `machine`: threads, memory and devices.
- `results`: finished runs as tables, and measures of their strokes.
- `pages`: HTML pages of runs and sweeps.
- `files`: safe reading and writing of files, progress, text for terminals.
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
