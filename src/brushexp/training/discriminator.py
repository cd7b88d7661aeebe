"""Teaching a network to tell valid strokes from spoilt ones, and measuring how well it does."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from lightning.pytorch.loggers import Logger
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from torch import Tensor, optim
from torch.nn import functional

from brushexp.errors import UserError
from brushexp.plugins.loss.discriminator import DISCRIMINATORS, NAME, Discriminator, shapes_of
from brushexp.strokes.prior import sample_prior
from brushexp.training.corruption import WAYS, spoil
from brushexp.training.datamodule import HELD_OUT
from brushexp.training.dataset import Split

EPOCH = 500  # batches that are called an epoch
QUANTILE = 0.05  # share of valid strokes whose score is below the threshold: a lower one lies well outside of them
JUDGED = 20_000  # held-out strokes of either sort
WARMUP = 0.05  # share of the training in which the learning rate rises
FINAL_RATE = 0.01  # of the learning rate, at the end
LOGGED = 50  # steps between two points of the curves
NOTICES = 5  # lines in the log of a run, where there is no terminal for a bar
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Plan:
    """How a discriminator is trained.

    Attributes:
        lr: highest learning rate.
        batch_size: valid strokes of a step, and as many spoilt ones.
        epochs: of 500 steps each; None without a limit.
        minutes: of wall time; None without a limit. The learning rate falls to its end with the first limit reached.
        seed: decides the strokes and what becomes of them.
    """

    lr: float
    batch_size: int
    epochs: int | None
    minutes: float | None
    seed: int

    def __post_init__(self) -> None:
        if self.epochs is None and self.minutes is None:
            raise UserError("neither epochs nor minutes is set, so training would never end; set epochs=12")
        for name in ("lr", "minutes"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UserError(f"{name}={value:g} is not a positive number; give {name} another value")


class Training:
    """Moves the weights of a discriminator until it tells valid strokes from spoilt ones.

    The loss is -log sigma(D(valid)) - log(1 - sigma(D(spoilt))) (Goodfellow et al., 2014), and, so that the slope leads
    back from anywhere and not only at the border, -log sigma(D(milder) - D(spoilt)): a stroke that is half as spoilt
    scores higher.

    Args:
        network: trained in place.
        plan: how.

    Attributes:
        step: steps taken.
        seconds: of wall time in `run` so far.
        stop: set from outside: finish after the present step, for this reason.
    """

    def __init__(self, network: Discriminator, plan: Plan) -> None:
        self.network, self.plan = network.train(), plan
        self.optimizer = optim.Adam(network.parameters(), plan.lr, betas=(0.9, 0.99))
        self.generator = torch.Generator().manual_seed(plan.seed)
        self.step, self.seconds, self.stop = 0, 0.0, ""
        self.loss = math.nan

    @property
    def progress(self) -> float:
        """How much of the training is done, 0 to 1."""
        shares = [0.0]
        if self.plan.epochs is not None:
            shares.append(self.step / max(self.plan.epochs * EPOCH, 1) if self.plan.epochs else 1.0)
        if self.plan.minutes is not None:
            shares.append(self.seconds / (60 * self.plan.minutes))
        return min(1.0, max(shares))

    def run(self, loggers: Sequence[Logger] = ()) -> None:
        """Train until a limit is reached or ``stop`` is set, with a progress bar."""
        begin, noticed = time.monotonic(), 0
        with _bar() as bar:
            task = bar.add_task("training", total=1.0, state="")
            while self.progress < 1 and not self.stop:
                curves = self._take_step()
                self.seconds = time.monotonic() - begin
                bar.update(task, completed=self.progress, state=self._state())
                if self.step % LOGGED == 0:
                    for logger in loggers:
                        logger.log_metrics(curves, step=self.step)
                if bar.disable and int(self.progress * NOTICES) > noticed:
                    noticed = int(self.progress * NOTICES)
                    log.info("%d %% (step %d): %s", 100 * self.progress, self.step, self._state())
        for logger in loggers:
            logger.save()
        self.network.eval()

    def _take_step(self) -> dict[str, float]:
        n, device = self.plan.batch_size, self.network.threshold.device
        known = valid_shapes(2 * n, self.plan.seed, 2 * n * self.step)
        spoilt = spoil(known[n:], self.generator)
        scores = self.network(torch.cat([known[:n], spoilt.shapes, spoilt.milder]).to(device))
        valid, bad, milder = scores.split(n)
        told_apart = functional.softplus(-valid).mean() + functional.softplus(bad).mean()
        in_order = functional.softplus(bad - milder).mean()
        share = FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * self.progress))
        for group in self.optimizer.param_groups:
            group["lr"] = self.plan.lr * share * min(1.0, (self.progress + 1e-3) / WARMUP)
        self.optimizer.zero_grad(set_to_none=True)
        (told_apart + in_order).backward()
        self.optimizer.step()
        self.step += 1
        self.loss = float(told_apart.detach())
        return {"loss/logistic": self.loss, "loss/order": float(in_order.detach())}

    def _state(self) -> str:
        return f"loss {self.loss:.4f}"


def valid_shapes(n: int, seed: int, first: int = 0) -> Tensor:
    """Shapes (n, 7) of strokes number ``first`` and on of the prior."""
    return shapes_of(sample_prior(n, seed, first))


@torch.no_grad()
def set_threshold(network: Discriminator, seed: int) -> None:
    """Let the threshold be the score that `QUANTILE` of held-out valid strokes stay below."""
    valid = valid_shapes(JUDGED, seed, HELD_OUT[Split.VALIDATION])
    scores = network(valid.to(network.threshold.device))
    network.threshold.copy_(scores.quantile(QUANTILE))


@torch.no_grad()
def judge(network: Discriminator, seed: int) -> dict[str, float]:
    """How well held-out valid and spoilt strokes are told apart.

    Returns:
        ``accuracy`` at a score of 0, ``auc`` (a spoilt stroke scores below a valid one so often) of all and by the way
        strokes were spoilt, ``threshold``, and the ``hinge`` max(0, threshold - score) of valid and of spoilt strokes.
        Some that are called spoilt are valid, so neither accuracy nor AUC can reach 1.
    """
    known = valid_shapes(2 * JUDGED, seed, HELD_OUT[Split.TEST])
    spoilt = spoil(known[JUDGED:], torch.Generator().manual_seed(seed + 1))
    device, threshold = network.threshold.device, float(network.threshold)
    valid, bad = (network(shapes.to(device)).cpu() for shapes in (known[:JUDGED], spoilt.shapes))
    return {
        "accuracy": float(torch.cat([valid > 0, bad <= 0]).double().mean()),
        "auc": area_under_curve(valid, bad),
        **{f"auc_{name}": area_under_curve(valid, bad[spoilt.way == k]) for k, name in enumerate(WAYS)},
        "threshold": threshold,
        "hinge_valid": float((threshold - valid).clamp_min(0).mean()),
        "hinge_spoilt": float((threshold - bad).clamp_min(0).mean()),
    }


def save(training: Training, path: Path) -> dict[str, object]:
    """Set the threshold, judge, and write the discriminator with its recipe.

    Returns:
        what `judge` found, and what the files are.
    """
    network, plan = training.network, training.plan
    set_threshold(network, plan.seed)
    figures = judge(network, plan.seed)
    recipe = {
        "options": {},
        "data": {"valid": "strokes.prior", "spoilt": list(WAYS), "seed": plan.seed},
        "training": {**asdict(plan), "steps": training.step, "seconds": training.seconds},
        "figures": figures,
    }
    digest = DISCRIMINATORS.save(path, NAME, network.cpu(), recipe, half=False)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    return {**figures, "discriminator_hash": digest, "parameters": parameters, "bytes": path.stat().st_size}


def area_under_curve(above: Tensor, below: Tensor) -> float:
    """Share of pairs in which the first scores higher, ties half: the area under the ROC curve (Mann and Whitney)."""
    order = below.sort().values
    less, not_more = (torch.searchsorted(order, above, right=right).double().mean() for right in (False, True))
    return float((less + not_more) / (2 * len(below)))


def _bar() -> Progress:
    console = Console(stderr=True)
    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[state]}"), TimeElapsedColumn())
    return Progress(TextColumn("training"), *columns, console=console, disable=not console.is_terminal, transient=True)
