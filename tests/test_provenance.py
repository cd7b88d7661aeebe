"""Tests that every run records its versions, and that tables report how the versions differ between runs."""

import hashlib
import json
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest
import torch
from program import run
from sweeps import collect, make_run, note

import brushexp
from brushexp.pages.sweep_page import sweep_page
from brushexp.results.provenance import remark_on_provenance
from brushexp.results.runs import gather
from brushexp.results.tables import write_run_tables
from brushexp.system import environment
from brushexp.system.environment import git_state, project_state

SMALL = ("image=chelsea", "resolution=24", "strokes=9", "steps=2", "frames=0", "report=false")
MADE = {
    "brushexp": {"version": "0.1.0", "commit": "a" * 40, "dirty": False, "changes": None},
    "project": {"commit": "b" * 40, "dirty": False, "changes": None},
    "python": "3.11.7", "torch": "2.8.0", "numba": "0.62.0", "processor": "A", "gpu": None,
    "plugins": {"sobel.py": "1", "mine.py": "1"},
}  # fmt: skip


def git(folder: Path, *words: str) -> str:
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    done = subprocess.run(["git", "-C", str(folder), *identity, *words], check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    """Make a git repository whose one commit holds a loss, its helper module and an order."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):  # of a hook that runs the tests
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "a project"
    (folder / "plugins").mkdir(parents=True)
    (folder / "plugins" / "_scale.py").write_text("SCALE = 2.0\n")
    (folder / "plugins" / "doubled.py").write_text(
        "from brushexp.contracts import register\n"
        "from brushexp.contracts.families import Loss\n"
        "from brushexp_plugins._scale import SCALE\n\n\n"
        '@register("loss", "doubled")\n'
        "class Doubled(Loss):\n"
        "    def forward(self, view):\n"
        "        return SCALE * view.mean((view.image - view.target).square())\n"
    )
    (folder / "plugins" / "unused.py").write_text(
        "from brushexp.contracts import register\n"
        "from brushexp.contracts.members import Area\n\n\n"
        '@register("order", "unused")\n'
        "class Unused(Area):\n"
        "    pass\n"
    )
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "commit", "-qm", "first")
    return folder


def test_a_repository_is_described_by_its_commit_and_by_what_differs_from_it(project, tmp_path):
    clean = {"commit": git(project, "rev-parse", "HEAD"), "dirty": False, "changes": None}
    (project / "outputs").mkdir()
    (project / "outputs" / "new.txt").write_text("git does not track it")
    assert git_state(project) == git_state(project / "plugins") == clean
    states = []
    for text in ("SCALE = 3.0\n", "SCALE = 4.0\n"):
        (project / "plugins" / "_scale.py").write_text(text)
        states.append(git_state(project))
    assert [one["dirty"] for one in states] == [True, True]
    assert len({one["changes"] for one in [*states, clean]}) == 3
    assert git_state(tmp_path) is None


def test_a_brushexp_in_a_repository_that_does_not_track_it_has_no_commit(project, monkeypatch):
    installed = project / "environment"
    installed.mkdir()
    (installed / "__init__.py").write_text("")
    monkeypatch.setattr(environment, "PACKAGE", installed)
    environment.code_state.cache_clear()
    try:
        assert environment.code_state() == {"version": brushexp.__version__}
        assert project_state(project) == git_state(project) is not None
        git(project, "add", "environment/__init__.py")
        environment.code_state.cache_clear()
        assert environment.code_state()["commit"] == git_state(project)["commit"]
        assert project_state(project) is None, "it is told once"
    finally:
        environment.code_state.cache_clear()


def test_without_git_a_run_says_only_versions(project, monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert git_state(project) is None


def test_a_run_records_commit_versions_machine_and_the_plugin_files_in_use(project):
    done = run(*SMALL, "loss=[mse,doubled]", "output=x", cwd=project, BRUSHEXP_PLUGINS="")
    assert done.returncode == 0, done.stderr
    made = json.loads((project / "x" / "metrics.json").read_text())["provenance"]
    assert made["project"] == git_state(project)
    assert made["brushexp"]["version"] == brushexp.__version__
    here = platform.python_version(), version("torch"), version("numba")
    assert (made["python"], made["torch"], made["numba"]) == here
    assert made["processor"]
    assert made["gpu"] is None
    files = {name: (project / "plugins" / name).read_bytes() for name in ("doubled.py", "_scale.py")}
    assert made["plugins"] == {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    assert str(project) not in json.dumps(made)
    assert str(Path(brushexp.__file__).parents[1]) not in json.dumps(made)


def test_a_painting_in_memory_says_with_what_it_was_made():
    painting = brushexp.paint("chelsea", look="plain", resolution=24, strokes=9, steps=1)
    assert painting.metrics["provenance"]["torch"] == torch.__version__
    assert painting.metrics["provenance"]["plugins"] == {}


@pytest.mark.parametrize(("other", "remark"), [
    ({}, ""),
    ({"torch": "2.9.0"}, "These runs differ in PyTorch (2.8.0, 2.9.0)."),
    ({"gpu": "H", "numba": None}, "These runs differ in Numba (0.62.0, none); GPU (none, H)."),
    ({"brushexp": MADE["brushexp"] | {"commit": "c" * 40}},
     "These runs differ in commit of brushexp (aaaaaaa, ccccccc)."),
    ({"project": MADE["project"] | {"dirty": True, "changes": "d"}},
     "These runs differ in uncommitted changes of the project."),
    ({"plugins": {"sobel.py": "2", "other.py": "1"}}, "These runs differ in plugin file sobel.py."),
    ({"plugins": {"other.py": "1"}}, ""),  # another setting, not another version
    (None, "1 of 3 runs have no record of their versions."),
    ({"plugins": "broken", "project": 3}, "These runs differ in commit of the project (bbbbbbb, none)."),
])  # fmt: skip
def test_a_table_says_in_one_line_in_what_its_runs_differ(tmp_path, other, remark):
    for number in range(3):
        make_run(tmp_path, {"seed": str(number)}, psnr=20.0 + number, seconds=1.0, provenance=MADE)
    note(tmp_path, 2, provenance=None if other is None else MADE | other)
    frame = collect(tmp_path)
    assert remark_on_provenance(frame) == remark
    write_run_tables(tmp_path, frame)
    plain = (tmp_path / "table.md").read_text().replace("\\", "")
    page = sweep_page(tmp_path, frame)
    for text in (plain, page):
        assert remark in text
        assert ("differ in" in text or "no record" in text) == bool(remark)
    assert "provenance" not in (tmp_path / "table.csv").read_text()


def test_runs_of_earlier_versions_make_a_table_without_a_remark(tmp_path):
    old = Path(__file__).parent / "old_files" / "stopped"
    assert remark_on_provenance(gather([old], tmp_path)) == ""
    for number in range(2):
        make_run(tmp_path, {"seed": str(number)}, psnr=20.0, seconds=1.0)
    assert remark_on_provenance(collect(tmp_path)) == ""
