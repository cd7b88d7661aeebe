"""Define multilayer perceptrons on region features, which are fitted in minutes and evaluated without PyTorch."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits as logistic_loss

from brushexp_recovery.model.logistic import sigmoid

Array = NDArray[Any]

HIDDEN = (64, 32)  # units of the two layers
CLIP = 6.0  # standard deviations to which features are clamped
BATCH = 2048  # examples per step
PEAK_RATE = 3e-3  # peak learning rate
WEIGHT_DECAY = 1e-3
LOSS_SMOOTHING = 0.02  # weight of a step's loss in the running mean
ITERATIONS = 100  # maximum number of L-BFGS iterations


class Perceptron(nn.Module):
    """A perceptron with two hidden layers on standardised features (N, F); `forward` returns log-odds (N, outputs)."""

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
        return self.layers(self.standardise(features))

    def standardise(self, features: Tensor) -> Tensor:
        """Standardise features (N, F) and clamp them to `CLIP`."""
        return ((features - self.mean) / self.scale).clamp(-CLIP, CLIP)

    def weights(self) -> "PerceptronWeights":
        """Return an equivalent function that does not use PyTorch, because PyTorch is slow for few examples."""
        linear = [layer for layer in self.layers if isinstance(layer, nn.Linear)]
        layers = tuple(
            torch.cat([layer.weight.detach().T, layer.bias.detach()[None]]).float().numpy() for layer in linear
        )
        return PerceptronWeights(self.mean.float().numpy(), self.scale.float().numpy(), layers)


@dataclass(frozen=True)
class PerceptronWeights:
    """The float32 weights of a perceptron; calling them with features (N, F) returns probabilities (N, ``outputs``)."""

    mean: Array  # (F,)
    scale: Array  # (F,)
    layers: tuple[Array, ...]  # (inputs + 1, outputs) each; the last row is the bias

    def __call__(self, features: Array) -> Array:
        x = np.clip((features - self.mean) / self.scale, -CLIP, CLIP)
        for number, layer in enumerate(self.layers):
            x = (np.maximum(x, 0) if number else x) @ layer[:-1] + layer[-1]
        return sigmoid(x)


def fit_perceptron(perceptron: Perceptron, features: Array, goal: Array, weight: Array, steps: int, seed: int) -> float:
    """Fit a perceptron that maps features (N, F) to targets (N, outputs) in [0, 1], with example weights (N,).

    Returns:
        The final running mean of the logistic loss.
    """
    generator = torch.Generator().manual_seed(seed)
    x = torch.from_numpy(features)
    y = torch.from_numpy(goal.astype(np.float32))
    w = torch.from_numpy((weight / weight.mean()).astype(np.float32))[:, None]
    perceptron.mean.copy_(x.mean(0))
    perceptron.scale.copy_(x.std(0) + 1e-3)
    optimizer = torch.optim.AdamW(perceptron.parameters(), PEAK_RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, PEAK_RATE / 100)
    mean_loss = 0.0
    for _ in range(steps):
        rows = torch.randint(len(x), (BATCH,), generator=generator)
        loss = (logistic_loss(perceptron(x[rows]), y[rows], reduction="none") * w[rows]).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        mean_loss += LOSS_SMOOTHING * (float(loss.detach()) - mean_loss)
    return mean_loss


def fit_last_layer(perceptron: Perceptron, features: Array, goal: Array, weight: Array, ridge: float) -> None:
    """Fit only the last layer of a perceptron to targets (N, outputs) in [0, 1], with example weights (N,).

    The loss includes the squared changes to the layer, weighted by ``ridge``. The fit uses L-BFGS in float64; if there
    are no targets, the layer stays unchanged.
    """
    if not len(goal):
        return
    *hidden, last = perceptron.layers
    with torch.no_grad():
        activation = nn.Sequential(*hidden)(perceptron.standardise(torch.from_numpy(features).float())).double()
    matrix, bias = (parameter.detach().double() for parameter in last.parameters())
    matrix_change = torch.zeros_like(matrix, requires_grad=True)
    bias_change = torch.zeros_like(bias, requires_grad=True)
    changes = [matrix_change, bias_change]
    y = torch.from_numpy(goal.astype(float))
    w = torch.from_numpy(weight / weight.mean()).double()[:, None]
    optimizer = torch.optim.LBFGS(changes, max_iter=ITERATIONS, line_search_fn="strong_wolfe")

    def loss_of() -> Tensor:
        optimizer.zero_grad()
        log_odds = activation @ (matrix + matrix_change).T + bias + bias_change
        penalty = ridge * (matrix_change.square().sum() + bias_change.square().sum())
        loss = (w * logistic_loss(log_odds, y, reduction="none")).mean() + penalty
        loss.backward()
        return loss

    optimizer.step(loss_of)
    with torch.no_grad():
        for parameter, change in zip(last.parameters(), changes, strict=True):
            parameter.add_(change)
