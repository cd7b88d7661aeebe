"""``task=train_recovery``: train the network that finds strokes."""

from pathlib import Path

import torch
from brushexp_training.fitting.network_fitting import NetworkJob, train_network, training_recipe
from omegaconf import DictConfig

from brushexp.pictures.folders import pictures_of
from brushexp.system.progress import showing
from brushexp_recovery.judging import fit_beliefs, fit_judges
from brushexp_recovery.model import NAME, RECOVERIES, RecoveryModel, load_model
from brushexp_recovery.network import StrokeNetwork
from brushexp_recovery.synthesis_paintings import PICTURES
from brushexp_recovery.training import HELD_OUT_COUNT, VALIDATED, RecoveryData, RecoveryModule

BELIEVED = 34  # held-out paintings from here on are for order and confidence, those before for the judges


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train, write weights and figures into the run's folder, and return those of metrics.json."""
    return train_network(RecoveryJob, cfg, folder, start)


class RecoveryJob(NetworkJob):
    """Train a network on paintings that are made meanwhile, and then what judges its answers."""

    module: RecoveryModule
    data: RecoveryData

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg = cfg
        self.pictures_painted = pictures_of(PICTURES if cfg.subjects is None else cfg.subjects)
        self.data = RecoveryData(
            Path(cfg.sets), self.pictures_painted, cfg.seed, cfg.batch_size, cfg.paintings, cfg.painters
        )
        self.started_from = None if cfg.start is None else recipe_of(cfg.start)
        learnt = cfg.start is not None
        self.module = RecoveryModule(load_model(cfg.start).network if learnt else StrokeNetwork(), cfg.lr, learnt)
        self.weights = folder / f"{NAME}.safetensors"
        self.use = f"brushexp recover image=PICTURE weights={self.weights}"

    def finish(self) -> dict[str, object]:
        model = RecoveryModel()
        model.network.load_state_dict(self.module.network.state_dict())
        model.eval()
        self._save(model, {})  # whatever may fail below
        self.data.paint()
        with showing("learning to judge") as show:
            judged = fit_judges(model, self.data.held_out(BELIEVED, VALIDATED), self.cfg.seed, show)
        judged |= fit_beliefs(model, self.data.held_out(HELD_OUT_COUNT, BELIEVED), self.cfg.seed)
        self.data.teardown("fit")
        figures: dict[str, object] = {**self.module.figures, **judged}
        return {
            **figures,
            "recovery_hash": self._save(model, figures),
            "parameters": sum(parameter.numel() for parameter in model.parameters()),
            "bytes": self.weights.stat().st_size,
        }

    def _save(self, model: RecoveryModel, figures: dict[str, object]) -> str:
        recipe = {
            "options": {},
            "data": {"subjects": [Path(name).name for name in self.pictures_painted], "seed": self.cfg.seed},
            "training": training_recipe(self.module, self.cfg) | {"started_from": self.started_from},
            "figures": figures,
        }
        return RECOVERIES.save(self.weights, NAME, model, recipe)


def recipe_of(checkpoint: str) -> dict[str, object]:
    """Return what identifies weights, and how they were trained."""
    recipe = RECOVERIES.read_recipe(RECOVERIES.path_of(checkpoint))
    return {"hash": recipe["hash"], **recipe["training"]}
