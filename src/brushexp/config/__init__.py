"""The keys of tasks (`schema`, `options`, `rules`), their configs (`words`, `publish`, `compose`), and the `check`."""
