"""TensorBoard and Weights & Biases, as members of the family ``logger``."""

from brushexp_trackers import tensorboard, wandb

__all__ = ["tensorboard", "wandb"]
