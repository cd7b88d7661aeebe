"""Tests of the ``next:`` line after a painting: it suits the typed command and never changes the number of strokes."""

from pathlib import Path

import pytest

from brushexp.runs.closing import suggestion
from brushexp.system.words import table_of_words

FOLDER = Path("outputs/x")


@pytest.mark.parametrize(
    ("words", "proposed"),
    [
        (["image=a.jpg"], "brushexp a.jpg abstract"),
        (["image=a.jpg", "output=x", "overwrite=true"], "brushexp a.jpg abstract"),
        (["image=a.jpg", "quality=draft"], "brushexp a.jpg quality=normal"),
        (["image=a.jpg", "quality=draft", "look=ink"], "brushexp a.jpg look=ink quality=normal"),
        (["image=a.jpg", "quality=fine"], "brushexp a.jpg quality=fine abstract"),
        (["image=a.jpg", "look=oil", "catalogue=x"], "brushexp export outputs/x resolution=4096"),
        (["image=a.jpg", "abstraction=0.7"], "brushexp a.jpg abstraction=0.7 look=watercolour"),
        (["image=a.jpg", "detail=0.25"], "brushexp a.jpg detail=0.25 look=watercolour"),
        (["image=a.jpg", "look=gouache"], "brushexp a.jpg look=gouache palette=muted"),
        (["image=a.jpg", "look=gouache", "palette.values=5"], "brushexp export outputs/x resolution=4096"),
        (["image=a.jpg", "look=ink"], "brushexp export outputs/x resolution=4096"),
        (["image=a.jpg", "style.image=b.jpg"], "brushexp a.jpg style.image=b.jpg abstract"),
        (["image=a.jpg", "change.tubes.tubes=zorn", "+change=[tubes]"], "brushexp export outputs/x to=plan"),
        (["image=a.jpg", "look=tubes"], "brushexp export outputs/x to=plan"),
        (["resume=outputs/x"], "brushexp export outputs/x resolution=4096"),
    ],
)
def test_what_is_proposed_fits_what_was_typed(words, proposed):
    assert suggestion(words, FOLDER).partition(": brushexp ")[2] == proposed.removeprefix("brushexp ")


def test_nothing_proposed_sets_the_number_of_strokes():
    assert not any(word.startswith(("strokes=", "detail=")) for word in table_of_words("next"))
    assert all(
        {"gives"} <= proposal.keys() <= {"gives", "after", "unless"} for proposal in table_of_words("next").values()
    )
