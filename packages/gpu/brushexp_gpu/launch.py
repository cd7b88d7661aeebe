"""Mark inlined functions of kernels, and launch kernels."""

from typing import Any

import torch
import triton


def inline(function: Any) -> Any:
    """Mark a function that kernels call, except for the interpreter, which would have to rewrite it."""
    return function if triton.knobs.runtime.interpret else triton.jit(function)


def launch(kernel: Any, programs: int, *arguments: Any, **options: Any) -> None:
    """Launch ``programs`` programs of a kernel on the device of its first tensor; 0 is allowed."""
    if programs:
        with torch.cuda.device_of(arguments[0]):
            kernel[(programs,)](*arguments, **options)
