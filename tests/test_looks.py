"""Tests of looks: typed words override a look's settings, whatever plugins they name, and quality scales the effort."""

import re
import shutil

import pytest
from omegaconf import OmegaConf
from program import ended
from refusals import refuses

from brushexp.cli.program import expand_arguments
from brushexp.config import compose
from brushexp.config.check import check
from brushexp.config.compose import folders_of, presets_of
from brushexp.config.looks import SCALED
from brushexp.config.own_files import check_own_files
from brushexp.config.publish import offer, prepare
from brushexp.config.schema import PaintTask
from brushexp.registry import build_named, plugin_of
from brushexp.system.words import conf_folders
from brushexp.tasks import paint

LOOKS = sorted(path.stem for folder in conf_folders() for path in (folder / "look").glob("*.yaml"))
MINE = """# @package _global_
# my own
defaults:
  - _self_
  - override /init: grid
  - override /loss: [mse, kl, width]

steps: 30
background: white
init:
  shift: true
optimizer:
  lr: 0.07
loss:
  kl:
    weight: 0.5
"""


PLAIN_VARIETY = build_named("change", "variety", {}).amount


def composed(words: str = ""):
    return compose.compose_config(expand_arguments(words.split()))


@pytest.fixture
def mine(tmp_path):
    """Return a function that composes configs with a user's own look."""
    (tmp_path / "look").mkdir()
    (tmp_path / "look" / "mine.yaml").write_text(MINE)
    offer([*conf_folders(), tmp_path])
    yield lambda words="": composed(f"look=mine {words}")
    offer(conf_folders())


def test_a_look_of_ones_own_is_one_file_what_is_typed_wins_and_the_rest_stays(mine, tmp_path):
    cfg = mine()
    check(cfg)
    values = cfg.steps, cfg.background, cfg.init.shift, cfg.optimizer.lr, cfg.loss.kl.weight
    assert values == (30, "white", True, 0.07, 0.5)
    assert presets_of(tmp_path / "look") == {"mine": "my own"}
    assert cfg.pixels_per_stroke == PaintTask.pixels_per_stroke  # defaults that the look does not set stay
    jobs = [composed(f"look={look} loss={loss}") for look in ("oil", "plain") for loss in ("[mse]", "[mse,kl]")]
    assert [list(cfg.loss) for cfg in jobs] == 2 * [["mse"], ["mse", "kl"]]
    assert jobs[1].loss.kl.weight != jobs[3].loss.kl.weight
    assert plugin_of(jobs[0].renderer).name == "textured"
    before = mine()
    for typed, same, changed in TYPED:
        after = mine(typed)
        check(after, typed.split())
        for key in same.split():
            assert OmegaConf.select(after, key) == OmegaConf.select(before, key)
        for key, value in changed.items():
            assert OmegaConf.select(after, key) == value


TYPED = [  # words typed with a look, what they keep, and what they change
    ("steps=7 effort=9", "init loss optimizer", {"steps": 7}),
    ("init=slic", "loss optimizer", {"init.width": 0.8}),
    ("init=grid", "init loss optimizer", {}),
    ("loss=[mse]", "init optimizer", {"loss.mse.weight": 1.0, "loss.kl": None}),
    ("loss=[kl,l1]", "init loss.kl", {"loss.l1.weight": 1.0}),
    ("optimizer=sgd", "init loss", {"optimizer.lr": 12.0}),
    ("init.shift=false loss.kl.weight=2", "optimizer", {"init.shift": False, "loss.kl.weight": 2.0}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), [
    ("init:\n  shifted: true\ndefaults:\n  - override /init: grid\n", "init=grid"),
    ("loss:\n  kl:\n    weight: much\n", "loss=kl"),
    ("init:\n  shifted: true\n", r"init\.shifted is not an option of init=slic; see all: brushexp init=slic --help"),
    ("- steps\n", "not a YAML mapping"),
    ("defaults: [oil, _self_]\n", "oil in its defaults does not choose a plugin; write '- override /init: slic'"),
    ("defaults:\n  - init: slic\n", "{'init': 'slic'} in its defaults does not choose a plugin"),
    ("init: slic\n", "init is slic; put options below 'init:', and choose it by '- override /init: ...' in "),
    ("loss: [mse]\n", r"loss is \['mse'\]; put options below 'loss:'"),
    ("loss: mse\n", "loss is mse; put options below"),
    ("loss:\n  mse: 2\n", "loss is 2; put options below"),
])  # fmt: skip
@pytest.mark.usefixtures("hydra_restore_singletons")
def test_a_look_that_does_not_fit_is_refused_where_it_is_chosen(tmp_path, text, message):
    (tmp_path / "look").mkdir()
    (tmp_path / "look" / "wrong.yaml").write_text(f"# @package _global_\n{text}")
    folders = [*conf_folders(), tmp_path]
    offer(folders)
    assert compose.compose_config(["look=plain"], folders).task == "paint", "nobody has chosen it"
    refuses(message, compose.compose_config, ["look=wrong"], folders)


@pytest.mark.parametrize(("name", "content", "message"), [
    ("look", b"hello", r"is not a config .*; write lines like 'steps: 100'"),
    ("look", b"steps: 100\n", "would set nothing; its first line must be: # @package _global_"),
    ("experiment", b"", "would set nothing"),
    ("experiment", b"# @package _global_\ndefaults: oil\n", "has defaults that are not a list; .*/look: oil'"),
    ("renderer", b"\x82\xff", "is not a config .*; write lines like"),
    ("renderer", b"[" * 9999, "is not a config"),
    ("renderer", b"!!python/name:os.system", "is not a config"),
    ("pictures", b"a: 1", "is not a config .*; write lines like '- photo.jpg'"),
])  # fmt: skip
def test_a_config_that_is_something_else_is_told_and_refused_where_it_is_chosen(
    tmp_path, caplog, name, content, message
):
    (tmp_path / "conf" / name).mkdir(parents=True)
    (tmp_path / "conf" / name / "wrong.yaml").write_bytes(content)
    folders = folders_of(tmp_path)
    assert check_own_files(folders, ["image=coffee"]) == {tmp_path / "conf" / name / "wrong.yaml"}
    assert re.search(rf"wrong\.yaml {message}", caplog.text)
    refuses(rf"wrong\.yaml {message}", check_own_files, folders, [f"{name}=wrong"])


@pytest.mark.parametrize("content", ["defaults: 5\nvariety: 0.2\n", "change: 3\nwet: 1\n", "loss: 3\n", "5\n"])
def test_a_wrong_look_disturbs_no_run_that_has_not_chosen_it(tmp_path, content):
    (tmp_path / "conf" / "look").mkdir(parents=True)
    (tmp_path / "conf" / "look" / "wrong.yaml").write_text(f"# @package _global_\n{content}")
    prepare(tmp_path)
    assert composed().task == "paint"
    offer(conf_folders())


@pytest.mark.parametrize(("lines", "variety", "wet"), [
    ("variety: 0.2", 0.2, None),
    ("variety: 0\nwet: 0", 0, None),
    ("wet: 0.5", PLAIN_VARIETY, 0.5),
    ("defaults:\n  - override /change: [wet]\nwet: 0.3", None, 0.3),
    ("change:\n  variety:\n    amount: 0.3\nwet: 0.1", 0.3, 0.1),
])  # fmt: skip
def test_a_look_may_have_the_words_for_options_of_changes(tmp_path, hydra_restore_singletons, lines, variety, wet):
    (tmp_path / "look").mkdir()
    (tmp_path / "look" / "mine.yaml").write_text(f"# @package _global_\n{lines}\n")
    folders = [*conf_folders(), tmp_path]
    offer(folders)
    cfg = compose.compose_config(["look=mine"], folders)
    check(cfg)
    assert {name: node.amount for name, node in cfg.change.items()} == {
        name: amount for name, amount in (("variety", variety), ("wet", wet)) if amount is not None
    }
    offer(conf_folders())


def test_a_wrong_file_is_told_and_left_out_and_presets_of_another_folder_are_listed(tmp_path):
    for folder, text in (("conf", "hello"), ("mine", "# @package _global_\nsteps: 9\n")):
        (tmp_path / folder / "look").mkdir(parents=True)
        (tmp_path / folder / "look" / "smooth.yaml").write_text(text)
    code, output = ended(tmp_path, "image=chelsea", "resolution=16", "steps=1", "frames=0", "output=run")
    assert code == 0
    assert "smooth.yaml is not a config" in output
    code, output = ended(tmp_path, "image=chelsea", "look=smooth")
    assert (code, output.count("\n")) == (1, 1)
    assert "smooth.yaml is not a config" in output
    shutil.rmtree(tmp_path / "conf")
    code, output = ended(tmp_path, "--config-dir", "mine", "look=smoth")
    assert code == 1
    assert "look=smoth does not exist; did you mean smooth? (see" in output
    refuses("--config-dir none: there is no such folder", folders_of, tmp_path, ["--config-dir", "none"])
    code, output = ended(tmp_path, "--config-dir", "mine", "--cfg", "job", "--package", "order", "order=area")
    assert (code, "every: 50" in output) == (0, True), "flags stand anywhere"


@pytest.mark.parametrize("look", LOOKS)
def test_a_look_composes_with_everything_and_quality_scales_it(look):
    assert any(look in presets_of(folder / "look") for folder in conf_folders())
    without = "renderer=analytic loss=[mse] paper=smooth palette=own"
    for words in ("init=grid quality=best style.brushwork=null", without):
        check(composed(f"look={look} {words}"))
    cfg, fine = (composed(f"look={look} {words}") for words in ("", "effort=2 detail=4"))
    check(cfg)
    assert fine.steps == 2 * cfg.steps
    assert fine.pixels_per_stroke == cfg.pixels_per_stroke / 4
    assert set(SCALED) <= set(cfg)


@pytest.mark.filterwarnings("ignore:.*in eval mode")
@pytest.mark.parametrize("look", LOOKS)
def test_a_look_paints(look, run_task, tmp_path):
    words = ("image=astronaut", "resolution=64", "steps=3", "finish_steps=1", "frames=0", "report=false", "threads=1")
    result = run_task(paint, f"look={look}", *words)
    assert result["psnr"] > (4 if look == "ink" else 8)  # a drawing leaves the paper white
    assert result["status"] == "completed"


def test_a_word_adds_a_change_whose_options_another_look_sets(tmp_path, hydra_restore_singletons):
    (tmp_path / "look").mkdir()
    (tmp_path / "look" / "mine.yaml").write_text("# @package _global_\nwet: 0.5\n")
    folders = [*conf_folders(), tmp_path]
    offer(folders)
    for look, amount in (("look=plain", 0.2), ("look=mine", 0.2), ("look=pastel", 0.2)):
        cfg = compose.compose_config(expand_arguments([look, f"wet={amount}"]), folders)
        check(cfg)
        assert cfg.change.wet.amount == amount
        assert "variety" in cfg.change
    assert compose.compose_config(expand_arguments(["look=mine"]), folders).change.wet.amount == 0.5
    offer(conf_folders())
