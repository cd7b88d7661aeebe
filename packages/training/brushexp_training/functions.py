"""``brushexp.simulate`` and ``brushexp.train_renderer``: simulate brush strokes, and train networks that draw them."""

import time
from os import PathLike
from typing import Any

from brushexp.contracts import build, plugin_of
from brushexp.contracts.families import Renderer, Simulated
from brushexp.contracts.runs import create, note_words, perform, release_folder, settings_of, take_folder, undisturbed
from brushexp.contracts.strokes import parameters_of, sample_prior


def simulate(n: int, *, engine: str = "fluid", seed: int = 0, **options: Any) -> tuple[Any, Simulated]:
    """Simulate strokes of a brush in memory; return parameters (n, 10) in [-1, 1], and pictures on empty canvases.

    Args:
        n: number of strokes, sampled from the prior.
        engine: name of the simulator plugin.
        seed: seed of all randomness.
        options: options of the engine, such as ``window=64``.

    >>> parameters, strokes = simulate(2, engine="disc", window=32)
    >>> parameters.shape, strokes.images.shape
    (torch.Size([2, 10]), torch.Size([2, 4, 32, 32]))
    """
    with undisturbed():
        parameters = parameters_of(sample_prior(n, seed))
        return parameters, create("engine", engine, **options)(parameters, seed=seed)


def train_renderer(output: str | PathLike[str], *, renderer: str = "neural", **overrides: Any) -> Renderer:
    """Train a renderer on simulated strokes, as ``task=train`` does, and return it with its weights.

    Args:
        output: folder of the run, which will contain the weights and their recipe; ``paint(renderer=..., **{
            "renderer.checkpoint": output / "neural.safetensors"})`` paints with them.
        renderer: name of the renderer to train.
        overrides: command-line overrides: ``data="strokes"``, ``minutes=30``, ``batch_size=32``, ``simulate=None``.

    Raises:
        UserError: a setting is invalid or the training fails; the message is the same as on the command line.
    """
    start, settings = time.monotonic(), settings_of("train", {"renderer": renderer, **overrides}, output)
    folder, cfg = settings.folder, settings.cfg
    assert folder is not None
    from brushexp_training.tasks import train  # noqa: PLC0415  (Lightning)

    with settings.as_asked():
        try:
            take_folder(folder, cfg)
            note_words(folder, cfg, settings.words)
            perform(train, cfg, folder, start)
        finally:
            release_folder(folder)
    node = cfg.renderer.copy()
    node.checkpoint = str(folder / f"{plugin_of(cfg.renderer).name}.safetensors")
    return build(node)
