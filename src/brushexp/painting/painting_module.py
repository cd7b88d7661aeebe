"""What every painting is to Lightning and to the callbacks, however its strokes come to be."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import lightning as L
from torch import Tensor, nn

from brushexp.painting.components import Components
from brushexp.painting.curves import Anytime, Curves
from brushexp.painting.picture import Depth, Picture
from brushexp.painting.schedule import STEPS_PER_EPOCH, Epoch, Schedule
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes


class PaintingModule(L.LightningModule):
    """A picture that gets nearer to its target step by step: goals, bar, film, curves and page read nothing else."""

    resumable = False  # whether an interrupted fit can go on from a checkpoint

    def __init__(self, components: Components, picture: Picture, schedule: Schedule) -> None:
        super().__init__()
        self.components, self.picture, self.schedule = components, picture, schedule
        self.renderers = nn.ModuleList(stage.renderer.requires_grad_(False) for stage in components.stages)
        self.losses = nn.ModuleDict(components.losses)
        self.depth = Depth(components.order)
        self.evaluations = 0  # of the losses so far; an optimiser may need several for a step
        self.stop = ""  # why the fit ends before its last step
        self.trouble = ""  # where strokes would have become no numbers (`DIVERGED`); they stay as before that step
        self.anytime = Anytime()  # how good the picture was after how many seconds
        self.terms: dict[str, Tensor] = {}  # the losses of the last step, unweighted
        self._curves = Curves()

    def __setattr__(self, name: str, value: Any) -> None:
        """Lightning notes the hook that it is in forty times a step, and a module looks for parameters each time."""
        if name == "_current_fx_name":
            object.__setattr__(self, name, value)
        else:
            super().__setattr__(name, value)

    @abstractmethod
    def strokes(self) -> Strokes:
        """The strokes now, without gradient; ``depth`` says which lies on which."""

    @property
    def renderer(self) -> Renderer:
        return self.picture.renderer

    @property
    def is_coarse(self) -> bool:
        """Whether the next step looks at a smaller picture."""
        return False

    @property
    def title(self) -> str:
        """What the progress bar says."""
        return "painting"

    @property
    def is_done(self) -> bool:
        """Whether all steps are taken."""
        return self.schedule.step >= self.schedule.steps

    @property
    def progress(self) -> float:
        """How much of the present stage is done, 0 to 1."""
        done, steps = self.schedule.stage_progress
        return done / steps if steps else 1.0

    def state_line(self) -> str:
        loss = sum(self.components.losses[name].weight * float(term) for name, term in self.terms.items())
        told = f", loss {loss:.5f}" if self.terms else ""
        return f"step {self.schedule.step} of {self.schedule.steps}{told}, {psnr_of(self.picture.error):.2f} dB"

    def drawn(self) -> Tensor:
        """The whole picture (3, H, W) now."""
        return self.picture.draw(self.strokes(), self.depth.front_to_back)

    def latest(self) -> Tensor:
        """The whole picture as the steps last saw it; as it is now before the first one."""
        return self.drawn() if (last := self.picture.last) is None else last

    def hand_over(self) -> None:
        """Make the strokes what a run leaves."""

    def train_dataloader(self) -> Epoch:
        return Epoch(range(STEPS_PER_EPOCH))

    @abstractmethod
    def prepare(self) -> None:
        """Whatever takes time and is no painting: compile what the steps need."""

    def on_fit_start(self) -> None:
        self.prepare()
        self.schedule.start()
        self._curves.begin(self)

    def on_train_start(self) -> None:
        self.trainer.should_stop |= self.is_done

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        self._curves.write(self, is_last=self.is_done)
        self.trainer.should_stop |= self.is_done or bool(self.stop)

    def on_train_end(self) -> None:
        self.schedule.pause()
