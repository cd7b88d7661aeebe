"""Declare the keys of tasks (`schema`, `keys`, `rules`), build (`words`, `publish`, `compose`) and `check` configs."""

import warnings

# Warnings of Hydra 1.4 and OmegaConf 2.4 about their next versions: docs/decisions/014-dependencies.md
warnings.filterwarnings("ignore", r"(?s).*Hydra 1\.5|register_new_resolver\(\) is deprecated")
