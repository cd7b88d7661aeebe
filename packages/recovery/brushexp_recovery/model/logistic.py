"""Define logistic models, whose log-odds are linear functions of features."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits as logistic_loss

Array = NDArray[Any]

RIDGE = 3e-4  # weight of the squared weights in the loss
ITERATIONS = 200  # maximum number of L-BFGS iterations


def sigmoid(log_odds: Array) -> Array:
    """Convert log-odds to probabilities."""
    return 1 / (1 + np.exp(-log_odds))


def log_odds_of(linear: nn.Linear, features: Array) -> Array:
    """Compute the log-odds (N,) that a logistic model predicts from features (N, F), in float64."""
    bias = 0.0 if linear.bias is None else float(linear.bias.detach())
    odds: Array = features @ linear.weight.detach().double().numpy()[0] + bias
    return odds


def fit_logistic(linear: nn.Linear, features: Array, goal: Array) -> None:
    """Fit a logistic model on features (N, F) to targets (N,) in [0, 1]; leave it unchanged if there are no targets.

    The logistic regression uses L-BFGS in float64, with a ridge penalty on the weights of the scaled features.
    """
    if not len(goal):
        return
    scale = features.std(0) + 1e-6
    x = torch.from_numpy(features / scale)
    y = torch.from_numpy(goal.astype(float))
    weight = torch.zeros(x.shape[1], dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(1, dtype=torch.float64, requires_grad=linear.bias is not None)
    optimizer = torch.optim.LBFGS([weight, bias], max_iter=ITERATIONS, line_search_fn="strong_wolfe")

    def loss_of() -> Tensor:
        optimizer.zero_grad()
        loss = logistic_loss(x @ weight + bias, y) + RIDGE * weight.square().sum()
        loss.backward()
        return loss

    optimizer.step(loss_of)
    with torch.no_grad():
        linear.weight.copy_(weight / torch.from_numpy(scale))
        if linear.bias is not None:
            linear.bias.copy_(bias)
