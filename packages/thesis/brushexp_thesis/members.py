"""Metrics of the studies: PSNR of the flat and of the busy half, and MS-SSIM, which others publish."""

from brushexp_thesis import halves, ms_ssim

__all__ = ["halves", "ms_ssim"]
