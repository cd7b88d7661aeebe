"""Metrics rate a finished painting by a number; choose several with ``'metric=[psnr,ssim]'``."""
