"""Losses and metrics that look through feature networks."""

from brushexp_networks import lpips_loss, lpips_metric

__all__ = ["lpips_loss", "lpips_metric"]
