"""The network learns from crops of paintings that are made while it learns."""

import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import lightning as L
import numpy as np
import torch
from brushexp_training.fitting.network_module import NetworkModule
from brushexp_training.stroke_sets.datamodule import EPOCH_STEPS, StrokeLoader
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn, optim
from torch.nn.functional import binary_cross_entropy_with_logits as logistic

from brushexp.errors import UserError
from brushexp_recovery import network as maps
from brushexp_recovery.network import AFFINE, GEOMETRY, OFFSETS, OVER, StrokeNetwork
from brushexp_recovery.synthesis_crops import Crops, batch_of, crop
from brushexp_recovery.synthesis_paintings import Painted
from brushexp_recovery.synthesis_pool import load_painting
from brushexp_recovery.validating import Counts, counts_of

APART = (4.0,) * 2 + (1.5,) * 4 + (1.0,) * 8  # weight of pairs of different strokes, by offset
WEIGHTS = {"order": 1.5, "ground": 0.3, "centre": 0.1, "turn": 0.1, "size": 0.1, "share": 0.05}
FIRST_PAINTINGS = 8  # that must be there before learning begins
AHEAD = 1  # batches that are cut in advance
LOOK_AGAIN = 20  # steps after which new paintings are looked for
HELD_OUT, HELD_OUT_COUNT = 900_000, 56  # numbers of the paintings that the network does not learn from
VALIDATED = 6  # of them are for validation, the first ones
CROPS_HELD_OUT = 4  # of each of them
PAINTINGS = "[0-9]*.npz"  # in the folder of the pool
DECAY = 1e-4  # of the weights
SETTLED = 0.4  # share of a training after which normalisations keep their statistics: those of a few crops of unlike
# paintings tell the network what it will not be told when it looks at one


class RecoveryData(L.LightningDataModule):
    """Crops of a pool of paintings, which processes of their own go on filling; painting k depends on seed and k."""

    def __init__(
        self, folder: Path, pictures: Sequence[str], seed: int, batch_size: int, most: int, painters: int
    ) -> None:
        super().__init__()
        self.folder, self.pictures, self.seed = folder, list(pictures), seed
        self.batch_size, self.most, self.painters = batch_size, most, painters
        self.processes: list[subprocess.Popen[bytes]] = []
        self.held: dict[Path, Painted] = {}

    def setup(self, stage: str) -> None:
        if stage == "fit":
            self.paint()
            self._wait(self._training, min(FIRST_PAINTINGS, self.most))

    def teardown(self, stage: str) -> None:
        for process in self.processes:
            process.terminate()
        self.processes = []

    def paint(self) -> None:
        """Begin to make the paintings that are not there yet, in processes of their own."""
        command = [sys.executable, "-m", "brushexp_recovery.synthesis_pool"]
        command += [str(os.getpid()), str(self.folder), str(self.seed)]  # it sees by the number when this process ends
        ranges = [(k, self.most, self.painters) for k in range(self.painters)]
        for numbers in [(HELD_OUT, HELD_OUT + HELD_OUT_COUNT, 1), *ranges]:
            words = [*map(str, numbers), *self.pictures]
            self.processes.append(subprocess.Popen([*command, *words], start_new_session=True))

    def train_dataloader(self) -> StrokeLoader:
        return StrokeLoader(self._batches, EPOCH_STEPS)

    def val_dataloader(self) -> StrokeLoader:
        return StrokeLoader(lambda _epoch, _first: self._held_out_crops(), VALIDATED)

    def held_out(self, last: int, first: int = 0) -> list[Painted]:
        """Return paintings ``first`` to ``last - 1`` of those that the network does not learn from."""
        self._wait(self._held_out, last)
        return [load_painting(path) for path in self._held_out()[first:last]]

    def _held_out_crops(self) -> Iterator[Crops]:
        random = np.random.default_rng(self.seed)
        for painted in self.held_out(VALIDATED):
            yield batch_of([crop(painted, random) for _ in range(CROPS_HELD_OUT)])

    def _batches(self, epoch: int, first: int) -> Iterator[Crops]:
        """Cut each batch in a thread of its own while the network learns from the one before."""
        with ThreadPoolExecutor(1) as cutter:
            steps = range(epoch * EPOCH_STEPS + first, (epoch + 1) * EPOCH_STEPS)
            waiting = deque[Future[Crops]]()
            for step in steps:
                waiting.append(cutter.submit(self._batch, step))
                if len(waiting) > AHEAD:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()

    def _batch(self, step: int) -> Crops:
        if step % LOOK_AGAIN == 0 or not self.held:
            self.held |= {path: load_painting(path) for path in self._training() if path not in self.held}
        random = np.random.default_rng([self.seed, step])
        chosen = random.integers(len(self.held), size=self.batch_size)
        paintings = list(self.held.values())
        return batch_of([crop(paintings[number], random) for number in chosen])

    def _training(self) -> list[Path]:
        return [path for path in sorted(self.folder.glob(PAINTINGS)) if int(path.stem) < min(self.most, HELD_OUT)]

    def _held_out(self) -> list[Path]:
        return [path for path in sorted(self.folder.glob(PAINTINGS)) if int(path.stem) >= HELD_OUT]

    def _wait(self, paintings: Callable[[], list[Path]], count: int) -> None:
        while len(paintings()) < count:
            if self.processes and all(process.poll() is not None for process in self.processes):
                raise UserError("no paintings can be made to learn from; the error of their process stands above")
            time.sleep(0.5)


class RecoveryModule(NetworkModule):
    """Moves the weights of the network until its maps agree with what is known of the paintings."""

    title = "learning strokes"
    clip_norm = 2.0

    def __init__(self, network: StrokeNetwork, lr: float, learnt: bool = False) -> None:
        """Train a network; one that has ``learnt`` keeps the statistics of its normalisations from the first step."""
        super().__init__()
        self.network, self.lr, self.counts = network.train(), lr, Counts(0, 0, 0)
        self.settled = 0.0 if learnt else SETTLED
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def configure_optimizers(self) -> OptimizerLRScheduler:
        optimizer = optim.AdamW(self.network.parameters(), self.lr, weight_decay=DECAY)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": self.schedule(optimizer), "interval": "step"}}

    def on_train_batch_start(self, *_: object) -> None:
        if self.progress >= self.settled:
            for part in self.network.modules():
                if isinstance(part, nn.BatchNorm2d):
                    part.eval()

    def training_step(self, batch: Crops, batch_idx: int) -> Tensor:
        told = self.network(batch.image.contiguous(memory_format=torch.channels_last))
        self.seen += int(sum(len(labels.unique()) for labels in batch.labels))
        terms = losses_of(told.float().contiguous(), batch.labels, batch.geometry)  # channel by channel: twice as fast
        self.terms = {f"loss/{name}": term.detach() for name, term in terms.items()}
        return sum((WEIGHTS.get(name, 1.0) * term for name, term in terms.items()), torch.zeros(()))

    def validation_step(self, batch: Crops, batch_idx: int) -> None:
        told = self.network(batch.image).float()
        terms = losses_of(told, batch.labels, batch.geometry)
        counts = counts_of(told.cpu(), Crops(*(part.cpu() for part in batch)))
        self.counts = Counts(*map(sum, zip(self.counts, counts, strict=True))) if batch_idx else counts
        sums = {name: float(term) + batch_idx * self.figures.get(name, 0.0) for name, term in terms.items()}
        self.figures = {name: value / (batch_idx + 1) for name, value in sums.items()} | {"f1_affinity": self.counts.f1}
        self.validated = self.global_step
        if batch_idx + 1 == VALIDATED:
            self.log_dict({f"validation/{name}": value for name, value in self.figures.items()}, batch_size=1)

    def state_line(self) -> str:
        return f"loss {float(self.terms['loss/affinity']):.4f}" if self.terms else ""


def losses_of(told: Tensor, labels: Tensor, geometry: Tensor) -> dict[str, Tensor]:
    """Compare maps (B, `CHANNELS`, H, W) with labels (B, H, W) and geometry (B, 7, H, W)."""
    paint = (labels >= 0).to(told)
    area = paint.sum().clamp_min(1)
    own = told[:, AFFINE : AFFINE + GEOMETRY]
    off_centre = (own[:, maps.CENTRE] - geometry[:, 0:2]).abs().sum(1)
    turn = (own[:, maps.TURN] - geometry[:, 2:4]).square().sum(1)
    size = (own[:, [maps.WIDTH, maps.LENGTH]] - geometry[:, 4:6]).abs().sum(1)
    share = logistic(own[:, maps.SHARE], geometry[:, 6], reduction="none")
    return {
        "affinity": affinity_loss(told[:, :AFFINE], labels),
        "order": order_loss(told[:, AFFINE + GEOMETRY :], labels),
        "ground": logistic(own[:, maps.PAINT], paint),
        "centre": (off_centre * paint).sum() / area,
        "turn": (turn * paint).sum() / area,
        "size": (size * paint).sum() / area,
        "share": (share * paint).sum() / area,
    }


def affinity_loss(told: Tensor, labels: Tensor) -> Tensor:
    """Compute the mean over offsets of the weighted logistic loss of "the same stroke as here"."""
    losses = []
    for channel, ((dy, dx), weight) in enumerate(zip(OFFSETS, APART, strict=True)):
        here, there, logit = pairs_at(labels, told[:, channel], dy, dx)
        same = (here == there).to(logit)
        counts = torch.where(same > 0, 1.0, weight)
        losses.append((logistic(logit, same, reduction="none") * counts).sum() / counts.sum().clamp_min(1))
    return torch.stack(losses).mean()


def order_loss(told: Tensor, labels: Tensor) -> Tensor:
    """Compute the logistic loss of "the stroke there is above the one here", over pairs of different strokes."""
    total, count = told.new_zeros(()), 0
    for channel, (dy, dx) in enumerate(OVER):
        here, there, logit = pairs_at(labels, told[:, channel], dy, dx)
        differ = here != there
        total = total + (logistic(logit, (there > here).to(logit), reduction="none") * differ).sum()
        count += int(differ.sum())
    return total / max(count, 1)


def pairs_at(labels: Tensor, told: Tensor, dy: int, dx: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return labels here, labels at an offset, and what is told here, where both are in the picture."""
    height, width = labels.shape[1:]
    left, right = max(0, -dx), width - max(0, dx)
    here, logit = labels[:, : height - dy, left:right], told[:, : height - dy, left:right]
    return here, labels[:, dy:, left + dx : right + dx], logit
