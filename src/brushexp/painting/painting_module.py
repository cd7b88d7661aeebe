"""The LightningModule of every painting."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils._pytree import tree_map_only

from brushexp.compat.lightning import QuickModule, publish_values
from brushexp.painting.components import Components
from brushexp.painting.picture import Depth, Picture
from brushexp.painting.schedule import Pair, Schedule, add_pair
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes

STEPS_PER_EPOCH = 100
LOG_SECONDS = 0.25  # least time between two points of the curves: writing one costs as much as half a step


class Lazy(Tensor):
    """A number that is computed at its first use: a PSNR at every step would cost a part of the step."""

    compute: Callable[[], float]

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        args, kwargs = tree_map_only(
            cls, lambda number: torch.tensor(number.compute(), dtype=torch.float64), (args, kwargs or {})
        )
        return func(*args, **kwargs)


class Epoch:
    """The batches of an epoch, each made when a step asks for it.

    Its state is empty, but there: without one, Lightning does not resume a loader in the midst of an epoch.
    """

    def __init__(self, batches: Iterator[Any]) -> None:
        self.batches = batches

    def __iter__(self) -> Iterator[Any]:
        return islice(self.batches, STEPS_PER_EPOCH)

    def __len__(self) -> int:
        return STEPS_PER_EPOCH

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        pass


class PaintingModule(QuickModule):
    """Base module of all painters: it counts steps, draws the picture, and publishes losses, PSNR and why it ends."""

    resumable = False  # whether an interrupted fit can go on from a checkpoint

    def __init__(self, components: Components, picture: Picture, schedule: Schedule) -> None:
        super().__init__()
        self.components, self.picture, self.schedule = components, picture, schedule
        self.pictures = {"target": picture.target}  # (3, H, W) that the painting is made from, by name
        self.renderers = nn.ModuleList(stage.renderer.requires_grad_(False) for stage in components.stages)
        self.losses = nn.ModuleDict(components.losses)
        self.depth = Depth(components.order)
        self.evaluations = 0  # how often losses were evaluated; an optimiser may need several for a step
        self.stop = ""  # why the fit ends before its last step
        self.trouble = ""  # what was not finite in the step that was undone (`DIVERGED`)
        self.anytime: list[Pair] = []
        self.terms: dict[str, Tensor] = {}  # the losses of the last step, unweighted
        self.values: dict[str, Tensor] = {}  # callbacks and loggers read these values of the last step
        self._next_log_seconds = 0.0

    @abstractmethod
    def strokes(self) -> Strokes:
        """Return the present strokes, without gradient; ``depth`` orders them."""

    @property
    def renderer(self) -> Renderer:
        return self.picture.renderer

    @property
    def is_unready(self) -> bool:
        """Whether the picture says little of how good it will be: it is smaller, or some of its strokes will go."""
        return False

    @property
    def title(self) -> str:
        """Label of the progress bar."""
        return "painting"

    @property
    def is_done(self) -> bool:
        """Whether all steps are taken."""
        return self.schedule.step >= self.schedule.steps

    @property
    def progress(self) -> float:
        """Share of the present stage that is done, 0 to 1."""
        done, steps = self.schedule.stage_progress
        return done / steps if steps else 1.0

    def state_line(self) -> str:
        loss = sum(self.components.losses[name].weight * float(term) for name, term in self.terms.items())
        words = f", loss {loss:.5f}" if self.terms else ""
        return f"step {self.schedule.step} of {self.schedule.steps}{words}, {psnr_of(self.picture.error):.2f} dB"

    @property
    def front_to_back(self) -> Tensor:
        """Indices (N,) of the strokes, the uppermost first."""
        return self.depth.front_to_back.to(self.device)

    def draw_whole(self) -> Tensor:
        """Draw the whole picture (3, H, W)."""
        return self.picture.draw(self.strokes(), self.front_to_back)

    def latest(self) -> Tensor:
        """Return the whole picture as the steps last painted it; draw it before the first step."""
        return self.draw_whole() if (last := self.picture.last) is None else last

    def hand_over(self) -> None:
        """Make the strokes those that a run leaves."""

    @abstractmethod
    def prepare(self) -> None:
        """Compile what the steps need."""

    def publish(self) -> None:
        """Publish the losses, the PSNR of what the step has painted (before its strokes moved) and the seconds."""
        error, psnr = self.picture.error_now(), torch.empty(()).as_subclass(Lazy)
        psnr.compute = lambda: psnr_of(error())
        labels = {name: loss.label or name for name, loss in self.components.losses.items()}
        self.values = {f"loss/{labels[name]}": term for name, term in self.terms.items()}
        self.values |= {"psnr": psnr, "seconds": torch.tensor(self.schedule.seconds, dtype=torch.float64)}
        publish_values(self, self.values)

    def on_fit_start(self) -> None:
        self.prepare()
        self.schedule.start()
        self._next_log_seconds = 0.0
        if not self.anytime:
            add_pair(self.anytime, 0.0, psnr_of(self.picture.error))

    def on_train_start(self) -> None:
        self.trainer.should_stop |= self.is_done

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        """Log the first step, the last, and some between, at most four a second."""
        seconds = self.schedule.seconds
        every = self.trainer.log_every_n_steps if self._next_log_seconds else 1  # type: ignore[attr-defined]
        if self.is_done or (seconds >= self._next_log_seconds and self.trainer.global_step % every == 0):
            self._next_log_seconds = seconds + LOG_SECONDS
            values = {name: float(value) for name, value in self.values.items()}
            add_pair(self.anytime, values["seconds"], values["psnr"])
            for logger in self.loggers:
                logger.log_metrics(values, self.schedule.step - 1)  # Lightning numbers steps from 0
        self.trainer.should_stop |= self.is_done or bool(self.stop)

    def on_train_end(self) -> None:
        self.schedule.pause()
