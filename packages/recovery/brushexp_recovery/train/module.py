"""Train the network on crops of paintings."""

import torch
from brushexp_training.fitting.network_module import NetworkModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn, optim

from brushexp_recovery.model.unet import StrokeNetwork
from brushexp_recovery.train.crops import Crops
from brushexp_recovery.train.data import VALIDATED
from brushexp_recovery.train.losses import losses_of
from brushexp_recovery.train.validation import Counts, count_strokes

LOSS_WEIGHTS = {"order": 1.5, "ground": 0.3, "centre": 0.1, "turn": 0.1, "size": 0.1, "share": 0.05}  # 1 for others
WEIGHT_DECAY = 1e-4
# Share of a training after which normalisations keep their statistics, because the statistics of a few crops of
# different paintings give the network information that is not available for a single painting.
SETTLED = 0.4


class RecoveryModule(NetworkModule):
    """Lightning module that trains the network to predict maps that agree with the ground truth of paintings."""

    title = "learning strokes"
    clip_norm = 2.0

    def __init__(self, network: StrokeNetwork, lr: float, is_trained: bool = False) -> None:
        """Prepare to train a network; if it is already trained, freeze its batch normalisation from the first step."""
        super().__init__()
        self.network, self.lr, self.counts = network.train(), lr, Counts(0, 0, 0)
        self.settled = 0.0 if is_trained else SETTLED
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def configure_optimizers(self) -> OptimizerLRScheduler:
        optimizer = optim.AdamW(self.network.parameters(), self.lr, weight_decay=WEIGHT_DECAY)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": self.schedule(optimizer), "interval": "step"}}

    def on_train_batch_start(self, *_: object) -> None:
        if self.progress >= self.settled:
            for part in self.network.modules():
                if isinstance(part, nn.BatchNorm2d):
                    part.eval()

    def training_step(self, batch: Crops, batch_idx: int) -> Tensor:
        maps = self.network(batch.image.contiguous(memory_format=torch.channels_last))
        maps = maps.float().contiguous()  # channel by channel, which makes the losses twice as fast
        self.seen += int(sum(len(labels.unique()) for labels in batch.labels))
        terms = losses_of(maps, batch.labels, batch.attributes)
        self.terms = {f"loss/{name}": term.detach() for name, term in terms.items()}
        return sum((LOSS_WEIGHTS.get(name, 1.0) * term for name, term in terms.items()), torch.zeros(()))

    def validation_step(self, batch: Crops, batch_idx: int) -> None:
        maps = self.network(batch.image).float()
        terms = losses_of(maps, batch.labels, batch.attributes)
        counts = count_strokes(maps.cpu(), Crops(*(part.cpu() for part in batch)))
        self.counts = self.counts.plus(counts) if batch_idx else counts
        sums = {name: float(term) + batch_idx * self.figures.get(name, 0.0) for name, term in terms.items()}
        self.figures = {name: value / (batch_idx + 1) for name, value in sums.items()} | {"f1_affinity": self.counts.f1}
        self.validated = self.global_step
        if batch_idx + 1 == VALIDATED:
            self.log_dict({f"validation/{name}": value for name, value in self.figures.items()}, batch_size=1)

    def state_line(self) -> str:
        return f"loss {float(self.terms['loss/affinity']):.4f}" if self.terms else ""
