"""``task=train_predictor``: train the network that predicts strokes for ``init=predicted``."""

from pathlib import Path

import torch
from brushexp_training.fitting.network_fitting import NetworkJob, train_network, training_recipe
from omegaconf import DictConfig

from brushexp.contracts.runs import provenance_of
from brushexp_predictor.lay.decoding import FORMS
from brushexp_predictor.lay.network import PREDICTORS, SHIPPED_NAME, StrokePredictor, load_predictor
from brushexp_predictor.train.subjects import Subjects, load_subjects
from brushexp_predictor.train.training import PredictorData, PredictorModule


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train a network, write weights and figures to the run's folder, and return the values of metrics.json."""
    return train_network(PredictorJob, cfg, folder, start)


class PredictorJob(NetworkJob):
    """A job that trains a network on pictures generated during training."""

    module: PredictorModule
    data: PredictorData

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg, self.subjects = cfg, load_subjects(cfg.data)
        self.provenance = provenance_of(cfg)
        self.data = PredictorData(Subjects(list(self.subjects.values()), cfg.seed), cfg.batch_size)
        network = StrokePredictor(cfg.form) if cfg.start is None else load_predictor(cfg.start).requires_grad_()
        network.form = FORMS[cfg.form]
        self.module = PredictorModule(network, cfg.lr, cfg.seed)
        self.weights = folder / f"{cfg.form}.safetensors"
        self.use = f"brushexp PICTURE init=predicted init.checkpoint={self.weights}"

    def finish(self) -> dict[str, object]:
        network, figures = self.module.network.eval(), dict(self.module.figures)
        recipe = {
            "options": {"form": self.cfg.form},
            "data": {"pictures": list(self.subjects), "seed": self.cfg.seed},
            "training": training_recipe(self.module, self.cfg, self.provenance) | {"started_from": self.cfg.start},
            "figures": figures,
        }
        return {
            **figures,
            "predictor_hash": PREDICTORS.save(self.weights, SHIPPED_NAME, network, recipe),
            "parameters": sum(parameter.numel() for parameter in network.parameters()),
            "bytes": self.weights.stat().st_size,
        }
