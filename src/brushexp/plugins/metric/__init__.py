"""Metrics measure the quality of a finished painting; choose several with ``'metric=[psnr,ssim]'``."""
