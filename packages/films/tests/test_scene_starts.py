"""What lays the first strokes of a scene."""

import pytest

from brushexp.config.compose import composed
from brushexp.registry import plugin_of


@pytest.mark.parametrize(("words", "name", "checkpoint"), [
    ("look=plain", "predicted", "plain"),
    ("look=oil", "predicted", "brushed"),
    ("look=oil quality=draft", "predicted", "brushed"),
    ("look=ink", "drawing", None),
    ("look=vangogh", "rows", None),
    ("look=oil init=layers", "layers", None),
])  # fmt: skip
def test_scenes_begin_with_strokes_of_a_network_but_for_starts_that_make_a_look(words, name, checkpoint):
    film, painting = (composed([f"task={of}", *words.split()]) for of in ("film", "paint"))
    assert (plugin_of(film.init).name, film.init.get("checkpoint")) == (name, checkpoint)
    assert (film.steps, film.detail) == (painting.steps, painting.detail)
