"""Mark functions for inlining into kernels, and launch the kernels."""

from typing import Any

import torch
import triton


def inline(function: Any) -> Any:
    """Mark a function for inlining into kernels.

    For the interpreter, which would have to rewrite the function, return it unmarked.
    """
    return function if triton.knobs.runtime.interpret else triton.jit(function)


def launch(kernel: Any, programs: int, *arguments: Any, **options: Any) -> None:
    """Launch a kernel on the device of its first tensor; ``programs`` is the number of its programs, possibly 0."""
    if programs:
        with torch.cuda.device_of(arguments[0]):
            kernel[(programs,)](*arguments, **options)
