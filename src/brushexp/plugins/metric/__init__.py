"""Metrics: a finished painting -> one number. Pick several: ``'metric=[psnr,ssim]'``."""
