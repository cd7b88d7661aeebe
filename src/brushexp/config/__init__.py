"""The keys of tasks (`schema`, `options`, `rules`), their configs (`words`, `publish`, `compose`), and the `check`."""

import warnings

# What Hydra 1.4 and OmegaConf 2.4 say of the versions after them: docs/decisions/019-hydra-1.4.md
warnings.filterwarnings("ignore", r"(?s).*Hydra 1\.5|register_new_resolver\(\) is deprecated")
