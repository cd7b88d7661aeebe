"""The base LightningModule of all paintings."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import lightning as L
import torch
from torch import Tensor, nn

from brushexp.painting.components import Components
from brushexp.painting.picture import Depth, Picture
from brushexp.painting.schedule import Pair, Schedule, add_pair
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.change.base import Change, PaintingState
from brushexp.plugins.order.base import front_to_back
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes
from brushexp.system.status import Status

STEPS_PER_EPOCH = 100
LOG_SECONDS = 0.25  # shortest time between two points of the curves, because writing a point costs half a step
# Spurious warnings of Lightning: batches have no state to resume, and checkpoints are meant to follow their step.
UNFOUNDED = ".*your dataloader is not resumable|.*checkpoint will contain the model state AFTER optimization"


class PaintingModule(L.LightningModule):
    """Base module of all painters: counts steps, draws the picture, logs losses and PSNR, and records why a run ended.

    A batch is just a number, because each step itself chooses what to compare, depending on the previous step. The
    painter's own state contains everything that is needed to resume.
    """

    painted: tuple[int, int] | None = None  # height and width of the painting if the target is smaller
    resumable = False  # whether an interrupted fit can continue from a checkpoint
    is_untouched = False  # whether the strokes come from a catalogue and no step moves them

    def __init__(
        self, components: Components, picture: Picture, schedule: Schedule, *, seed: int, changes: Mapping[str, Change]
    ) -> None:
        super().__init__()
        self.automatic_optimization = False  # a step consists of more than losses and an optimiser
        self.components, self.picture, self.schedule = components, picture, schedule
        self.pictures = {"target": picture.target}  # pictures (3, H, W) from which the painting is made, by name
        self.renderers = nn.ModuleList(stage.renderer.requires_grad_(False) for stage in components.stages)
        self.losses = nn.ModuleDict(components.losses)
        self.depth = Depth(components.order)
        self.changes = changes  # changes by name, in the order in which they apply
        self.generator = torch.Generator().manual_seed(seed)
        self.evaluations = 0  # number of evaluations of the losses; an optimiser may need several per step
        self.stop: Status | None = None  # why the fit ends early
        self.trouble = ""  # what was not finite in a step that was undone (`Status.DIVERGED`)
        self.anytime: list[Pair] = []
        self.terms: dict[str, Tensor] = {}  # unweighted losses of the last step
        self.values: dict[str, Tensor] = {}  # values logged for the last step
        self._next_log_seconds = 0.0

    @abstractmethod
    def strokes(self) -> Strokes:
        """Return the current strokes without gradient; their order is given by ``depth``."""

    @property
    def renderer(self) -> Renderer:
        return self.picture.renderer

    @property
    def zoom(self) -> float:
        """Pixels of the painting per pixel of the target."""
        return 1.0 if self.painted is None else max(self.painted) / max(self.picture.size)

    @property
    def is_unready(self) -> bool:
        """Return whether the picture is not yet of final quality, because it is too small or has surplus strokes."""
        return False

    @property
    def title(self) -> str:
        """Label of the progress bar."""
        return "painting"

    @property
    def is_done(self) -> bool:
        """Return whether all steps have been taken."""
        return self.schedule.step >= self.schedule.steps

    @property
    def progress(self) -> float:
        """Completed fraction of the current stage, from 0 to 1."""
        done, steps = self.schedule.stage_progress
        return done / steps if steps else 1.0

    def state_line(self) -> str:
        loss = sum(self.components.losses[name].weight * float(term) for name, term in self.terms.items())
        words = f", loss {loss:.5f}" if self.terms else ""
        return f"step {self.schedule.step} of {self.schedule.steps}{words}, {psnr_of(self.picture.error):.2f} dB"

    @property
    def front_to_back(self) -> Tensor:
        """Indices (N,) of the strokes, top stroke first."""
        return self.depth.front_to_back.to(self.device)

    def draw_whole(self) -> Tensor:
        """Draw the whole picture (3, H, W)."""
        return self.picture.draw(self.strokes(), self.front_to_back)

    def latest(self, zoom: float = 1.0) -> Tensor:
        """Return the last whole picture painted by a step, or draw the picture if no step has been taken.

        With ``zoom`` below 1, the last step must have painted the picture at that size.
        """
        return self.draw_whole() if (last := self.picture.at(zoom).last) is None else last

    def hand_over(self) -> None:
        """Convert the strokes to the form in which the run saves them."""

    def now(self, **about: bool) -> PaintingState:
        """Return the painting's state to pass to changes; ``about`` sets further fields of `PaintingState`."""
        order = self.components.order
        return PaintingState(
            target=self.picture.target,
            focus=self.picture.focus,
            ground=self.picture.background,
            renderer=self.renderer,
            blend=self.picture.blend,
            step=self.schedule.step,
            steps=self.schedule.steps,
            generator=self.generator,
            strokes=self.strokes,
            order=lambda strokes: front_to_back(order.depth(strokes, None)),
            front_to_back=self.front_to_back,
            draw=self.picture.draw,
            zoom=self.zoom,
            **about,
        )

    @torch.no_grad()
    def finished_strokes(self) -> tuple[Strokes, Tensor]:
        """Apply `Change.end` for every change; return the final strokes and their order, front to back.

        The first N strokes correspond to the current strokes, within the limits of all changes; added strokes may
        follow.
        """
        strokes, order = self.strokes(), self.front_to_back
        for change in self.changes.values():
            strokes, order = change.end(strokes, order, self.now(is_over=True, is_untouched=self.is_untouched))
            if len(strokes) == len(self.front_to_back):
                strokes = self.within_limits(strokes)
        return strokes, order

    def enlarge(self, strokes: Strokes) -> Strokes:
        """Let changes adapt the final strokes after they have been scaled from the target's size to the painting's."""
        if len(strokes) == len(self.front_to_back):
            for change in self.changes.values():
                strokes = change.enlarge(strokes)
        return strokes

    def within_limits(self, strokes: Strokes) -> Strokes:
        """Bring N strokes within the limits of all changes."""
        return strokes

    @abstractmethod
    def prepare(self) -> None:
        """Compile the code that the steps need."""

    def train_dataloader(self) -> range:
        return range(STEPS_PER_EPOCH)

    def publish(self) -> None:
        """Pass values to callbacks: the losses, the elapsed seconds, and the PSNR of the picture before the step.

        The values are stored in ``trainer.callback_metrics``; `on_train_batch_end` passes some of them to loggers.
        """
        labels = {name: loss.label or name for name, loss in self.components.losses.items()}
        self.values = {f"loss/{labels[name]}": term for name, term in self.terms.items()}
        numbers = {"psnr": psnr_of(self.picture.error), "seconds": self.schedule.seconds}
        self.values |= {name: torch.tensor(number, dtype=torch.float64) for name, number in numbers.items()}
        # As in Lightning's LearningRateMonitor: `self.log` of three values takes a twentieth of a step at 512 px.
        self.trainer.callback_metrics.update(self.values)

    def on_fit_start(self) -> None:
        warnings.filterwarnings("ignore", UNFOUNDED)
        self.prepare()
        self.schedule.start()
        self._next_log_seconds = 0.0
        if not self.anytime:
            add_pair(self.anytime, 0.0, psnr_of(self.picture.error))

    def on_train_start(self) -> None:
        self.trainer.should_stop |= self.is_done

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        """Log the first step, the last step, and at most four steps per second between them."""
        seconds = self.schedule.seconds
        every = self.trainer.log_every_n_steps if self._next_log_seconds else 1  # type: ignore[attr-defined]
        if self.is_done or (seconds >= self._next_log_seconds and self.trainer.global_step % every == 0):
            self._next_log_seconds = seconds + LOG_SECONDS
            values = {name: float(value) for name, value in self.values.items()}
            add_pair(self.anytime, values["seconds"], values["psnr"])
            for logger in self.loggers:
                logger.log_metrics(values, self.schedule.step - 1)  # Lightning counts steps from 0
        self.trainer.should_stop |= self.is_done or bool(self.stop)

    def on_train_end(self) -> None:
        self.schedule.pause()
