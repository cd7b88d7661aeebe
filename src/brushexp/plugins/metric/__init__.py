"""Metrics: finished painting -> number. Choose any number: ``'metric=[psnr,ssim]'``."""
