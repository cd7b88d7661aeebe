"""Tests of sweeps over a list of settings: each setting is a job, and all jobs are checked before the first starts."""

from itertools import product
from types import SimpleNamespace

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.plugins import Plugins
from hydra.core.singleton import Singleton
from hydra.errors import ConfigCompositionException, HydraException
from program import run
from refusals import refuses

from brushexp.config.compose import search_path
from brushexp.config.mistakes import explanation
from brushexp.errors import UserError
from brushexp.results.runs import read_result
from brushexp.runs.run_folder import check_place
from brushexp.runs.sweep_jobs import check_jobs, move_job
from brushexp.system.words import SHIPPED, conf_folders

FOUND = search_path(conf_folders())  # lets Hydra find the configs of packages


def jobs(settings, arguments=(), pictures=()):
    """Combine settings, arguments and pictures into jobs, check the jobs, and return their overrides."""
    with initialize_config_dir(version_base="1.3", config_dir=str(SHIPPED)):
        loader = GlobalHydra.instance().config_loader()
        kind = Plugins.instance().class_name_to_class["hydra_plugins.brushexp_settings.SettingsSweeper"]
        sweeper = kind(settings=settings, pictures=list(pictures))
        sweeper.hydra_context = SimpleNamespace(config_loader=loader)
        sweeper.config = compose("config", overrides=FOUND, return_hydra_config=True)
        jobs = sweeper.combine(arguments)
        check_jobs(loader, sweeper.config, jobs)
        return jobs


def test_every_setting_is_one_job_and_stands_above_the_command_line_with_whose_sweeps_it_is_combined():
    settings = ["", "steps=100", "init=grid 'loss=[mse,kl]'"]
    assert jobs(settings) == [[], ["steps=100"], ["init=grid", "loss=[mse,kl]"]]
    refuses("steps is a key; type steps=", jobs, ["steps"])
    combined = jobs(["", "steps=9", "steps=1,2"], ["steps=50", "seed=0,1"])
    assert combined == [[f"steps={steps}", f"seed={seed}"] for steps, seed in product((50, 9, 1, 2), (0, 1))]
    refuses(r"interval\(1,9\) is not a list of values; try hydra/sweeper=optuna", jobs, ["", "steps=interval(1,9)"])


def test_words_for_changes_of_a_painting_are_words_of_settings_too_and_join_those_of_the_command_line():
    assert jobs(["", "wet=0.2", "wet=0,1 variety=0.1"]) == [
        [],
        ["change.wet.amount=0.2", "+change=[wet]"],
        *(
            [f"change.wet.amount={wet}", "change.variety.amount=0.1", "+change=[wet]"]
            for wet in (0, 1)
        ),
    ]  # fmt: skip
    typed = ["change.sizes.smallest=3", "+change=[sizes]"]
    assert jobs(["", "wet=0.2", "change=variety"], typed) == [
        typed,
        ["change.sizes.smallest=3", "+change=[wet,sizes]", "change.wet.amount=0.2"],
        ["change.sizes.smallest=3", "change=[variety,sizes]"],
    ]
    refuses("mixtures=5 is for tubes=", jobs, ["mixtures=5"])
    assert jobs(["mixtures=5"], ["look=tubes"]) == [["look=tubes", "change.tubes.mixtures=5"]]


@pytest.mark.usefixtures("hydra_restore_singletons")
def test_a_process_of_a_parallel_sweep_knows_lists_of_settings():
    Singleton.set_state(Singleton.get_state())  # as launchers do in their processes: Hydra publishes its sweepers again
    with initialize_config_dir(version_base="1.3", config_dir=str(SHIPPED)):
        cfg = compose("config", overrides=["experiment=speed_accuracy", *FOUND], return_hydra_config=True)
    assert len(cfg.hydra.sweeper.settings) > 2


def test_every_setting_is_painted_of_every_picture_unless_another_one_is_typed():
    painted = jobs(["", "steps=9"], ["seed=1"], pictures=["camera", "coffee"])
    assert painted == [
        [*words, f"image={name}"] if not words[1:] else [words[0], f"image={name}", words[1]]
        for words in (["seed=1"], ["seed=1", "steps=9"])
        for name in ("camera", "coffee")
    ]
    alone = jobs([""], pictures=["camera", "coffee"])
    assert alone == [[f"image={name}", f"hydra.sweep.subdir={name}"] for name in ("camera", "coffee")]
    assert jobs(["", "steps=9"], ["image=logo"], pictures=["camera", "coffee"]) == [
        ["image=logo"],
        ["image=logo", "steps=9"],
    ]


def test_jobs_have_folders_of_their_own_where_they_go_on_and_no_run_is_moved_away_from_its_files():
    def places(pictures, *words):
        with initialize_config_dir(version_base="1.3", config_dir=str(SHIPPED)):
            cfg = compose("config", overrides=["strokes=4", *words, *FOUND], return_hydra_config=True)
            check_place(cfg)
            loader = GlobalHydra.instance().config_loader()
            return check_jobs(loader, cfg, [["strokes=4", *words, f"image={one}"] for one in pictures])

    assert places(["camera", "coffee"]) == ["0", "1"]
    assert places(["camera"], "hydra.sweep.subdir=all") == ["all"]
    assert places(["camera", "coffee"], "hydra.sweep.subdir=x${image}") == ["xcamera", "xcoffee"]
    by_words = places(["camera", "coffee"], "hydra.sweep.subdir='${hydra.job.override_dirname}'")
    assert by_words == ["image=camera,strokes=4", "image=coffee,strokes=4"]
    cure = r"drop it, or type 'hydra\.sweep\.subdir=job\$\{hydra\.job\.num\}'"
    for subfolder, same in (("all", "all"), ("o${seed}", "o0")):
        message = f"job 1 .*: hydra.sweep.subdir={same} is also the folder of an earlier job; {cure}"
        refuses(message, places, ["camera", "coffee"], f"hydra.sweep.subdir={subfolder}")
    refuses(
        "chdir=true would break relative paths in the settings; drop it",
        places, ["camera"], "hydra.job.chdir=true",
    )  # fmt: skip
    assert move_job(["seed=1", "hydra.sweep.subdir=a"], "b c") == ["seed=1", "hydra.sweep.subdir=b c"]


@pytest.mark.parametrize(("override", "message"), [
    ("steps=5,-3", "job 1 of the sweep.*steps=-3 is not at least 0; try steps=500"),
    ("task=paint,export", "task=export needs catalogue"),
    ("optimizer.lr=0.1,wide", "wide"),
    ("init=grid,nope", "nope"),
    ("trainer.precision=32-true,abc", "job 1 of the sweep .*trainer.precision=abc is not one of 32-true, "),
    ("image=astronaut,nope.jpg", "job 1 of the sweep .*image=nope.jpg is not there; give the path of a picture"),
    ("strokes=9,9999999", "job 1 of the sweep .*set strokes to 262144 at most"),
    ("optimizer.name=Adam,Adm", "job 1 of the sweep .*torch.optim has no optimiser 'Adm'"),
])  # fmt: skip
def test_a_mistake_in_any_job_is_found_before_the_first_starts(override, message):
    with pytest.raises((UserError, ConfigCompositionException, HydraException), match=message):
        jobs([""], [override])


def test_a_renderer_of_the_sweep_is_proposed_for_an_option_that_another_one_has():
    words = ["-m", "renderer=analytic,neural", "renderer.checkpoint=x"]
    with pytest.raises(HydraException) as caught:
        jobs([""], words[1:])
    assert "'renderer=neural renderer.checkpoint=...'" in explanation(caught.value, conf_folders(), words)


@pytest.mark.parametrize("launcher", ["basic", "processes"])
def test_nothing_of_a_sweep_starts_when_one_of_its_jobs_is_wrong(launcher, tmp_path):
    words = ["-m", f"hydra/launcher={launcher}", "hydra.sweeper.settings=['','loss=brushwork']", "resolution=16"]
    done = run(*words, "steps=0", f"output={tmp_path}/s", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("brushexp: job 1 of the sweep (look=plain resolution=16 steps=0 output="), done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "s").exists()


def test_a_list_of_settings_on_the_command_line_is_a_sweep(tmp_path):
    settings = "hydra.sweeper.settings=['steps=1','seed=6']"
    words = ["-m", settings, "image=chelsea", "resolution=16", "steps=0", "frames=0", "report=false", "threads=1"]
    done = run(*words, f"output={tmp_path}/s", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    chosen = [read_result(tmp_path / "s" / name)["overrides"] for name in ("0", "1")]
    assert [(values["steps"], values.get("seed")) for values in chosen] == [("1", None), ("0", "6")]
