"""Metrics: finished painting -> number. Pick several: ``'metric=[psnr,ssim]'``."""
