"""``task=train_recovery``: train the network that finds strokes, and fit the models that score regions."""

from pathlib import Path

import torch
from brushexp_training.fitting.network_fitting import NetworkJob, train_network, training_recipe
from omegaconf import DictConfig

from brushexp.contracts.files import showing
from brushexp.contracts.pictures import pictures_of
from brushexp.contracts.runs import provenance_of
from brushexp_recovery.model.recovery_model import (
    CHECKPOINTS,
    SHIPPED_WEIGHTS,
    RecoveryModel,
    load_model,
    trained_families,
)
from brushexp_recovery.model.unet import StrokeNetwork
from brushexp_recovery.synthesis.families.family import find_families
from brushexp_recovery.synthesis.paintings import PICTURES
from brushexp_recovery.train.classifiers import fit_classifiers
from brushexp_recovery.train.data import HELD_OUT_COUNT, VALIDATED, RecoveryData
from brushexp_recovery.train.module import RecoveryModule
from brushexp_recovery.train.order_and_confidence import fit_order_and_confidence

FOR_CONFIDENCE = 34  # held-out paintings from this one on are for order and confidence, earlier ones for classifiers


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train the models, write their weights into the run's folder, and return the values for metrics.json."""
    return train_network(RecoveryJob, cfg, folder, start)


class RecoveryJob(NetworkJob):
    """A job that trains a network on paintings generated during training, then fits the models that score regions."""

    module: RecoveryModule
    data: RecoveryData

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg, self.provenance = cfg, provenance_of(cfg)
        self.subjects = pictures_of(PICTURES if cfg.subjects is None else cfg.subjects)
        learnt_before = () if cfg.start is None else trained_families(cfg.start)
        families = find_families().keys() - set(cfg.leave_out) if cfg.families else set()
        self.families = sorted(families | set(learnt_before))
        self.data = RecoveryData(
            Path(cfg.sets),
            self.subjects,
            cfg.seed,
            cfg.batch_size,
            cfg.paintings,
            cfg.painters,
            families,
        )
        self.started_from = None if cfg.start is None else recipe_of(cfg.start)
        network = StrokeNetwork() if cfg.start is None else load_model(cfg.start).network
        self.module = RecoveryModule(network, cfg.lr, is_trained=cfg.start is not None)
        self.weights = folder / f"{SHIPPED_WEIGHTS}.safetensors"
        self.use = f"brushexp recover image=PICTURE weights={self.weights}"

    def finish(self) -> dict[str, object]:
        model = RecoveryModel()
        model.network.load_state_dict(self.module.network.state_dict())
        model.eval()
        self.data.start_painting()
        with showing("learning to judge") as show:
            held_out = self.data.held_out_paintings(FOR_CONFIDENCE, VALIDATED)
            fitted = fit_classifiers(model, held_out, self.cfg.seed, show)
        held_out = self.data.held_out_paintings(HELD_OUT_COUNT, FOR_CONFIDENCE)
        fitted |= fit_order_and_confidence(model, held_out, self.cfg.seed)
        self.data.teardown("fit")
        figures: dict[str, object] = {**self.module.figures, **fitted}
        return {
            **figures,
            "recovery_hash": self._save(model, figures),
            "parameters": sum(parameter.numel() for parameter in model.parameters()),
            "bytes": self.weights.stat().st_size,
        }

    def _save(self, model: RecoveryModel, figures: dict[str, object]) -> str:
        recipe = {
            "options": {},
            "data": {
                "subjects": [Path(name).name for name in self.subjects],
                "seed": self.cfg.seed,
                "families": self.families,
            },
            "training": training_recipe(self.module, self.cfg, self.provenance) | {"started_from": self.started_from},
            "figures": figures,
        }
        return CHECKPOINTS.save(self.weights, SHIPPED_WEIGHTS, model, recipe)


def recipe_of(checkpoint: str) -> dict[str, object]:
    """Return the hash of a checkpoint's weights, and the recipe used to train them."""
    recipe = CHECKPOINTS.read_recipe(CHECKPOINTS.path_of(checkpoint))
    return {"hash": recipe["hash"], **recipe["training"]}
