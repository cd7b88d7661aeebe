"""Tests that painting does not import torch's compiler, and that optimisers take the same steps without it."""

import subprocess
import sys

import pytest
import torch
from torch import nn, optim

from brushexp.compat.deferred_compiler import OptimizedModule, without_compiler

PAINTS = """
import sys
from brushexp.__main__ import main

sys.argv = ["brushexp", "astronaut", "resolution=32", "strokes=20", "steps=3", "report=false", "output=run"]
main()
assert "lightning" in sys.modules
assert "torch._dynamo" not in sys.modules, "it takes longer to import than most steps"
"""


def test_a_painting_does_not_import_the_compiler(tmp_path):
    run = subprocess.run([sys.executable, "-c", PAINTS], check=False, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "run" / "painting.png").exists()


@pytest.mark.parametrize("kind", [optim.Adam, optim.SGD, optim.NAdam, optim.Adagrad, optim.LBFGS])
def test_an_optimizer_takes_the_same_steps_without_the_compiler(kind):
    def fit(kind):
        torch.manual_seed(0)
        parameter = nn.Parameter(torch.randn(5, dtype=torch.float64))
        optimizer = kind([parameter], lr=0.1)

        def closure():
            optimizer.zero_grad()
            loss = (parameter.cos() * parameter).sum()
            loss.backward()
            return loss

        losses = [optimizer.step(closure).item() for _ in range(5)]
        saved = optimizer.state_dict()
        optimizer.load_state_dict(saved)
        losses.append(optimizer.step(closure).item())
        return losses, parameter.detach()

    losses, parameter = fit(kind)
    own_losses, own_parameter = fit(without_compiler(kind))
    assert own_losses == losses
    assert torch.equal(own_parameter, parameter)
    assert not own_parameter.requires_grad


def test_compiled_modules_are_recognised():
    module = nn.Linear(2, 2)
    assert not isinstance(module, OptimizedModule)
    compiled = torch.compile(module, backend="eager")
    assert isinstance(compiled, OptimizedModule)
    assert not isinstance(module, OptimizedModule)
