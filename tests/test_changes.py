"""Tests of changes to a painting: their command-line words, call order, and state in resumed runs."""

from dataclasses import replace

import pytest
import torch
from painters import BACKGROUND, assert_resumes, fit, painter_of, take
from refusals import refuses

import brushexp
from brushexp.api.settings import settings_of
from brushexp.cli.program import expand_arguments
from brushexp.config.changes import expand_changes, shorten_words
from brushexp.config.check import check
from brushexp.config.compose import compose_config
from brushexp.painting.changes import build_changes
from brushexp.plugins.change.base import Change, by_rank
from brushexp.plugins.sampler.whole import Whole

GUIDES = "change.guides.lines=a.png"


@pytest.mark.parametrize(("words", "expanded"), [
    (["variety=0.3"], ["change.variety.amount=0.3"]),
    (["guides=a.png"], [GUIDES, "+change=[guides]"]),
    (["guides=a.png", "wet=0.5"], [GUIDES, "change.wet.amount=0.5", "+change=[guides,wet]"]),
    (["guides=a.png", "change=wet"], [GUIDES, "change=[wet,guides]"]),
    (["guides=a.png", "change=[guides,wet]"], [GUIDES, "change=[guides,wet]"]),
    (["guides=a.png", "+change=[wet]"], [GUIDES, "+change=[wet,guides]"]),
    (["guides=a.png", "change=[]"], [GUIDES, "change=[guides]"]),
    (["change=[]", "variety=0.3"], ["change=[variety]", "change.variety.amount=0.3"]),
    (["guides=null", "region="], []),
    (["tubes=zorn", "mixtures=5"],
     ["change.tubes.tubes=zorn", "change.tubes.mixtures=5", "look=tubes", "+metric=[ciede2000]"]),
    (["tubes=zorn", "look=oil", "metric=[psnr]"],
     ["change.tubes.tubes=zorn", "look=oil", "metric=[psnr]", "+change=[tubes]"]),
    (["look=tubes", "load=9"], ["look=tubes", "change.tubes.load=9"]),
    (["smallest=2mm", "width_cm=40"], ["change.sizes.smallest=2mm", "change.sizes.width_cm=40", "+change=[sizes]"]),
    (["look=tubes", "largest=9mm", "width_cm=40"],
     ["look=tubes", "change.sizes.largest=9mm", "change.tubes.width_cm=40", "change.sizes.width_cm=40",
      "+change=[sizes]"]),
    (["task=export", "wet=0.5"], ["task=export", "wet=0.5"]),
    (["task=measure", "region=[sky.png]"], ["task=measure", "region=[sky.png]"]),
])  # fmt: skip
def test_words_stand_for_options_of_changes_which_they_choose(words, expanded):
    assert expand_changes(words) == expanded


@pytest.mark.parametrize(("words", "short"), [
    (["image=a.png", "tubes=zorn", "mixtures=5"], ["image=a.png", "tubes=zorn", "mixtures=5"]),
    (["guides=a.png", "change=wet"], ["guides=a.png", "change=[wet,guides]"]),
    (["+change=[random_ground]", "wet=1"], ["+change=[random_ground,wet]", "wet=1"]),
    (["smallest=1", "width_cm=40"], ["smallest=1", "width_cm=40"]),
])  # fmt: skip
def test_they_are_written_again_as_they_were_typed(words, short):
    assert shorten_words(expand_changes(words)) == short
    assert expand_changes(short) == expand_changes(words), "and mean the same"


@pytest.mark.parametrize(("words", "message"), [
    (["mixtures=5"], "^mixtures=5 is for tubes=; add tubes=..., or drop mixtures$"),
    (["brushes=500"], "^brushes=500 is for tubes=; add tubes=..., or type strokes=...$"),
    (["width_cm=5"], "^width_cm=5 is for tubes= or smallest= or largest=; add tubes=..., or drop width_cm$"),
    (["task=guided", "guides=a.png"], "^task=guided has become a change; type guides=lines.png$"),
    (["task=repaint", "resume=x"], "^task=repaint has become a change; drop it$"),
    (["callbacks=[csv,wet_steps]"], r"^callbacks=wet_steps has become a change; type wet=0\.5 change\.wet\.every=10$"),
])  # fmt: skip
def test_a_word_without_its_change_and_those_of_earlier_versions_are_told_what_to_type(words, message):
    refuses(message, expand_changes, words)


def test_a_list_of_a_sweep_gets_the_name_of_a_word_and_a_sweep_of_lists_does_not():
    assert expand_changes(["change=[wet]", "guides=a.png,b.png"], sweep=True) == [
        "change=[wet,guides]", "change.guides.lines=a.png,b.png",
    ]  # fmt: skip
    for word in ("change=wet,sizes", "change=[wet],[sizes]"):
        refuses("cannot add guides to the sweep ", expand_changes, [word, "guides=a.png"], sweep=True)
    looks = expand_changes(["look=oil,tubes", "tubes=zorn"], sweep=True)
    assert looks[-1] == "+change=[tubes]", "not every look has it"


def chosen_by(*words):
    words = expand_arguments([*words])
    cfg = compose_config(words)
    check(cfg, words)
    return cfg.change


def test_the_changes_of_a_look_keep_its_options_and_typed_ones_win():
    assert chosen_by("coffee").variety.amount == 0.55
    assert chosen_by("coffee", "look=pastel", "wet=0.2").variety.amount == 0.55
    both = chosen_by("coffee", "look=pastel", "wet=0.2", "variety=0.1")
    assert (both.variety.amount, both.wet.amount, set(both)) == (0.1, 0.2, {"variety", "wet"})
    assert set(chosen_by("coffee", "change=wet")) == {"wet"}
    assert not chosen_by("coffee", "change=[]")


def test_python_takes_the_same_words():
    cfg = settings_of("paint", {"image": "coffee", "wet": 0.2, "variety": 0.1, "largest": 9}).cfg
    assert (cfg.change.wet.amount, cfg.change.variety.amount, cfg.change.sizes.largest) == (0.2, 0.1, "9")
    chosen = settings_of("paint", {"image": "coffee", "change": ["wet"], "smallest": "2mm"}).cfg.change
    assert list(chosen) == ["wet", "sizes"]
    assert list(build_changes(settings_of("paint", {"image": "coffee", "wet": 0.2}).cfg)) == ["variety", "wet"]


class Log(Change):
    """A change that records each call with the number of its step."""

    def __init__(self, notes):
        self.notes = notes

    def begin(self, strokes, state):
        self.notes.append(("begin", state.step))
        return strokes

    def aim(self, target, ground, state):
        self.notes.append(("aim", state.step, state.is_whole, torch.equal(target, state.target)))
        return target, ground

    def limit(self, strokes, before, rows, state):
        if before is not None:
            self.notes.append(("limit", state.step, len(strokes), state.is_over))
        return strokes

    def end(self, strokes, front_to_back, state):
        self.notes.append(("end", state.step, state.is_over))
        return strokes, front_to_back


def test_a_painter_asks_at_the_beginning_around_each_step_and_at_the_end():
    notes = []
    painter = painter_of(steps=2, n=20, options={"changes": {"log": Log(notes)}})
    take(painter, 2)
    painter.finished_strokes()
    assert notes == [
        ("begin", 0), ("aim", 0, True, True), ("limit", 0, 20, False), ("aim", 1, True, True),
        ("limit", 1, 20, False), ("end", 2, True),
    ]  # fmt: skip


class Aims(Change):
    """A change that sets the target to black and the background to white from the second step on."""

    def aim(self, target, ground, state):
        return (torch.zeros_like(target), torch.ones_like(ground)) if state.step else (target, ground)


@pytest.mark.parametrize("coarse", [0.0, 1.0])
def test_a_step_aims_at_what_changes_say_and_the_painting_keeps_its_target_and_ground(coarse):
    painter = painter_of(steps=40, n=60, options={"changes": {"aims": Aims()}, "coarse": coarse})
    own = painter.picture.own_target
    darkness = painter.strokes().color.mean()
    take(painter, 40)
    assert painter.strokes().color.mean() < 0.6 * darkness
    assert torch.equal(painter.picture.background, BACKGROUND)
    painter.hand_over()
    assert painter.picture.target is own


class Drifts(Change):
    """A change that shifts all strokes in every step by a distance that grows from step to step."""

    def __init__(self):
        self.steps = 0

    def aim(self, target, ground, state):
        self.steps += 1
        return target, ground

    def limit(self, strokes, before, rows, state):
        if before is None:
            return strokes
        return replace(strokes, position=strokes.position + 0.01 * self.steps)

    def state_dict(self):
        return {"steps": self.steps}

    def load_state_dict(self, state):
        self.steps = state["steps"]


def test_what_a_change_remembers_is_in_the_checkpoint(tmp_path):
    assert_resumes(lambda: painter_of(steps=8, options={"changes": {"drifts": Drifts()}}), 5, tmp_path)


class Red(Change):
    """A change that keeps only the red channel of colours."""

    rank = 5

    def limit(self, strokes, before, rows, state):
        return replace(strokes, color=strokes.color * torch.tensor([1.0, 0.0, 0.0]))


class Green(Change):
    """A change that colours all strokes green at the end."""

    def end(self, strokes, front_to_back, state):
        return replace(strokes, color=torch.tensor([0.0, 1.0, 0.0]).expand_as(strokes.color)), front_to_back


class One(Change):
    """A change that adds a copy of the first stroke on top at the end."""

    rank = 10

    def end(self, strokes, front_to_back, state):
        more = type(strokes).join(strokes, strokes[:1])
        return more, torch.cat([torch.tensor([len(strokes)]), front_to_back])


def test_ranks_decide_who_comes_last_and_limits_hold_at_the_end():
    changes = {"one": One(), "red": Red(), "green": Green()}
    assert list(by_rank(changes)) == ["green", "red", "one"]
    painter = painter_of(steps=1, n=9, sampler=Whole(), options={"changes": by_rank(changes)})
    fit(painter)
    assert painter.strokes().color[:, 1:].max() == 0
    strokes, order = painter.finished_strokes()
    assert (len(strokes), len(order)) == (10, 10)
    assert strokes.color.max() == 0, "green is none of red"


def test_strokes_of_a_catalogue_that_no_step_moves_are_not_ended_twice(tmp_path):
    small = {"image": "astronaut", "resolution": 48, "strokes": 30, "threads": 1, "look": "plain"}
    brushexp.paint(**small, steps=1, variety=0.8).save(tmp_path / "first")
    again = [
        brushexp.paint(**small | {"order": "fixed"}, steps=steps, variety=0.8, catalogue=str(tmp_path / "first"))
        for steps in (0, 1)
    ]
    first = brushexp.paint(**small, steps=1, variety=0.8)
    assert torch.equal(again[0].strokes.color[again[0].depth.argsort()], first.strokes.color[first.depth.argsort()])
    assert not torch.equal(again[1].strokes.color, again[0].strokes.color)
