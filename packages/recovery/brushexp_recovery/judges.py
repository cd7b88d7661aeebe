"""Small networks judge features of regions; they are fitted in minutes and asked without PyTorch."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits as logistic

Array = NDArray[Any]

HIDDEN = (64, 32)
CLIPPED = 6.0  # standard deviations beyond which a feature says no more
BATCH = 2048
RATE, DECAY = 3e-3, 1e-3
RIDGE = 3e-4  # price of the squared weights of a linear judge


class Judge(nn.Module):
    """Two hidden layers on standardised features (N, F); `forward` gives log-odds (N, `outputs`)."""

    mean: Tensor
    scale: Tensor

    def __init__(self, features: int, outputs: int = 1) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))
        sides = (features, *HIDDEN, outputs)
        layers: list[nn.Module] = []
        for before, after in pairwise(sides):
            layers += [nn.Linear(before, after), nn.ReLU()]
        self.layers = nn.Sequential(*layers[:-1])

    def forward(self, features: Tensor) -> Tensor:
        return self.layers(((features - self.mean) / self.scale).clamp(-CLIPPED, CLIPPED))

    def asked(self) -> "Asked":
        """Return the same without PyTorch, which is slow at small N."""
        linear = [layer for layer in self.layers if isinstance(layer, nn.Linear)]
        layers = tuple(
            torch.cat([layer.weight.detach().T, layer.bias.detach()[None]]).float().numpy() for layer in linear
        )
        return Asked(self.mean.float().numpy(), self.scale.float().numpy(), layers)


@dataclass(frozen=True)
class Asked:
    """Weights of a judge, float32; called with features (N, F) it gives probabilities (N, `outputs`)."""

    mean: Array  # (F,)
    scale: Array  # (F,)
    layers: tuple[Array, ...]  # (inputs + 1, outputs) each, the last row is added

    def __call__(self, features: Array) -> Array:
        x = np.clip((features - self.mean) / self.scale, -CLIPPED, CLIPPED)
        for number, layer in enumerate(self.layers):
            x = (np.maximum(x, 0) if number else x) @ layer[:-1] + layer[-1]
        return 1 / (1 + np.exp(-x))


def fit_judge(judge: Judge, features: Array, goal: Array, weight: Array, steps: int, seed: int) -> float:
    """Fit a judge to goals (N, outputs) in [0, 1] of features (N, F), weighted (N,); returns the loss at the end."""
    generator = torch.Generator().manual_seed(seed)
    x, y = torch.from_numpy(features), torch.from_numpy(goal.astype(np.float32))
    w = torch.from_numpy((weight / weight.mean()).astype(np.float32))[:, None]
    judge.mean.copy_(x.mean(0))
    judge.scale.copy_(x.std(0) + 1e-3)
    optimizer = torch.optim.AdamW(judge.parameters(), RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, RATE / 100)
    recent = 0.0
    for _ in range(steps):
        rows = torch.randint(len(x), (BATCH,), generator=generator)
        loss = (logistic(judge(x[rows]), y[rows], reduction="none") * w[rows]).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        recent += 0.02 * (float(loss.detach()) - recent)
    return recent


def fit_linear(linear: nn.Linear, features: Array, goal: Array) -> None:
    """Fit log-odds that are linear in features (N, F) to goals (N,) in [0, 1]; without any they stay as they are.

    Logistic regression by L-BFGS in float64, on features of deviation 1, with a small price on their weights.
    """
    if not len(goal):
        return
    scale = features.std(0) + 1e-6
    x, y = torch.from_numpy(features / scale), torch.from_numpy(goal.astype(float))
    weight = torch.zeros(x.shape[1], dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(1, dtype=torch.float64, requires_grad=linear.bias is not None)
    optimizer = torch.optim.LBFGS([weight, bias], max_iter=200, line_search_fn="strong_wolfe")

    def loss_of() -> Tensor:
        optimizer.zero_grad()
        loss = logistic(x @ weight + bias, y) + RIDGE * weight.square().sum()
        loss.backward()
        return loss

    optimizer.step(loss_of)
    with torch.no_grad():
        linear.weight.copy_(weight / torch.from_numpy(scale))
        if linear.bias is not None:
            linear.bias.copy_(bias)


def ask_linear(linear: nn.Linear, features: Array) -> Array:
    """Return the log-odds (N,) of features (N, F)."""
    bias = 0.0 if linear.bias is None else float(linear.bias.detach())
    odds: Array = features @ linear.weight.detach().double().numpy()[0] + bias
    return odds
