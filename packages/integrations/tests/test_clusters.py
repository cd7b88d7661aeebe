"""Test that sweeps can use Optuna to choose jobs, and Dask and submitit to run them, instead of Hydra's defaults."""

import os
import re
import signal

import pytest
from hydra_plugins.brushexp_optuna import better_direction
from program import ROOT, run
from refusals import refuses
from sweeps import note, read_csv

from brushexp.results.runs import objective_in
from brushexp.system.runtime import interruptible, reraise_signal

pytestmark = pytest.mark.slow
TINY = ["-m", "look=plain", "image=chelsea", "resolution=16", "steps=1", "report=false", "frames=0"]
STUDY = ["hydra/sweeper=optuna", "objective=l1", "optimizer.lr=interval(0.01,0.1)", "init=choice(grid,slic)"]


def test_the_tables_know_which_way_an_objective_is_better():
    assert better_direction("psnr", None) == better_direction("psnr", "maximize") == "maximize"
    assert better_direction("l1", None) == better_direction("steps", "minimize") == "minimize"
    for objective, typed, message in (
        (None, None, "try objective=psnr"), ("psnr", "minimize", "searches for the worst psnr; drop it"),
        ("steps", None, "add hydra.sweeper.direction=minimize or maximize"), ("l1", "down", "not one of maximize"),
    ):  # fmt: skip
        refuses(message, better_direction, objective, typed)
    assert objective_in({"psnr": 3, "status": "completed"}, "psnr") == 3.0
    words = "objective=status is not a metric of this run; choose one of psnr"
    refuses(words, objective_in, {"psnr": 3, "status": "completed", "on": True}, "status")


@pytest.mark.parametrize("number", [signal.SIGUSR1, signal.SIGUSR2])
def test_a_signal_of_the_cluster_ends_a_fit_and_then_does_what_it_did(number):
    heard = []
    before = signal.signal(number, lambda *_: heard.append("requeued"))
    try:
        with interruptible(lambda: heard.append("stopped"), "stopping"):
            os.kill(os.getpid(), number)
        assert heard == ["stopped"]
        reraise_signal()
        assert heard == ["stopped", "requeued"]
    finally:
        signal.signal(number, before)


def test_a_search_marks_what_fails_and_goes_on(tmp_path):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    words, study = [*TINY, *STUDY, "output=s"], tmp_path / "s"
    refused = run(*words, "strokes=range(5,9999999)", cwd=tmp_path)
    assert re.search("job 3 of the sweep .*strokes=9999999.*set strokes to", refused.stderr), refused.stderr
    assert not study.exists()
    done = run(*words, "hydra.sweeper.n_trials=2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    values = [float(row["l1"]) for row in read_csv(study / "table.csv")]
    assert f"best_value: {min(values)}" in (study / "optimization_results.yaml").read_text()
    for number, status in ((0, "interrupted"), (1, "failed")):
        note(study, number, status=status)
    for n in (3, 4):  # the killed trial is repeated first, once
        done = run(*words, f"hydra.sweeper.n_trials={n}", "resume=sweep", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    rows = read_csv(study / "table.csv")
    assert [row["status"] for row in rows] == ["interrupted", "failed", *3 * ["completed"]]
    rates = [row["optimizer.lr"] for row in rows]
    assert rates[0] == rates[2]
    assert len(set(rates)) == 4
    assert (study / "table.tex").exists()


@pytest.mark.parametrize(("launcher", "library", "seeds"), [
    ("dask hydra.launcher.n_jobs=1", "distributed", "0,1"), ("submitit_local", "submitit", "0"),
])  # fmt: skip
def test_jobs_of_other_launchers_meet_in_one_table(launcher, library, seeds, tmp_path):
    """A sweep has one table for all jobs; submitit runs just one here, because each job imports everything again."""
    pytest.importorskip(library)
    words = [*TINY, f"seed={seeds}", *f"hydra/launcher={launcher}".split(), "output=s"]
    done = run(*words, cwd=tmp_path, PYTHONPATH=str(ROOT / "src"))
    assert done.returncode == 0, done.stderr
    assert "worker process" not in done.stderr.lower(), "the launcher's own messages are for its developers"
    sweep = tmp_path / "s"
    assert [row["status"] for row in read_csv(sweep / "table.csv")] == len(seeds.split(",")) * ["completed"]
    assert all((sweep / name).exists() for name in ("table.md", "table.tex", "report.html", "sheet.png"))
