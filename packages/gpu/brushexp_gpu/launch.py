"""Mark the functions that kernels are made of, and start kernels."""

from typing import Any

import torch
import triton


def inline(function: Any) -> Any:
    """Mark a function that kernels call; the interpreter, which has to change what is marked, takes it as it is."""
    return function if triton.knobs.runtime.interpret else triton.jit(function)


def launch(kernel: Any, programs: int, *arguments: Any, **options: Any) -> None:
    """Start so many programs of a kernel where its first tensor is; none is no error."""
    if programs:
        with torch.cuda.device_of(arguments[0]):
            kernel[(programs,)](*arguments, **options)
