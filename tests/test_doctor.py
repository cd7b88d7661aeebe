"""Tests of ``brushexp doctor``, which prints fifteen lines about any installation, however broken it is."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import brushexp
from brushexp.cli import doctor

NAMES = ["brushexp", "Python", "system", "processor", "environment", "PyTorch", "GPU", "Numba", "kernels", "libraries"]
NAMES += ["extras", "missing", "configs", "plugins", "packages"]
# The command with only Python's own library importable; no probe is started.
ALONE = """
import sys

class Absent:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] not in {*sys.stdlib_module_names, "brushexp", "hydra_plugins"}:
            raise ModuleNotFoundError(f"No module named {name}", name=name)

sys.meta_path.insert(0, Absent)
from brushexp.__main__ import main
from brushexp.cli import doctor

doctor._run = lambda code: {}
sys.argv = ["brushexp", "doctor"]
main()
"""


def typed(*words: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess:
    """Run ``brushexp`` with the given words in a separate process."""
    command = [sys.executable, "-m", "brushexp", *words]
    return subprocess.run(
        command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, check=False, timeout=200
    )


def lines_of(text: str) -> dict[str, str]:
    """Map the name of each line to its mark and contents, after checking that there are fifteen lines."""
    lines = text.splitlines()
    assert len(lines) == 15
    return {line[2:14].strip(): line[0] + line[14:] for line in lines}


@pytest.mark.slow
def test_a_sound_installation_has_no_marks(tmp_path):
    done = typed("doctor", cwd=tmp_path)
    lines = lines_of(done.stdout)
    assert list(lines) == NAMES
    assert not [line for line in lines.values() if line.startswith("!")]
    assert done.returncode == 0
    assert brushexp.__version__ in lines["brushexp"]
    assert not [*tmp_path.iterdir()]


def test_broken_libraries_plugins_and_configs_are_named_and_the_other_lines_are_written(tmp_path):
    texts = {
        "plugins/mine.py": "def f(:\n",
        "conf/look/mine.yaml": "steps: 3\n",
        "libraries/torch.py": "raise ImportError('libcudart.so is not there')\n",
        "libraries/numba.py": "import os\nos._exit(9)\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    done = typed("doctor", cwd=tmp_path, PYTHONPATH=str(tmp_path / "libraries"), BRUSHEXP_PLUGINS="")
    lines = lines_of(done.stdout)
    assert lines["PyTorch"] == "!ImportError: libcudart.so is not there"
    assert lines["Numba"] == "!the import ends Python with exit code 9"
    assert "mine.py, line 1" in lines["plugins"]
    assert "mine.yaml would set nothing" in lines["configs"]
    marked = {name for name, line in lines.items() if line.startswith("!")}
    assert marked == {"PyTorch", "GPU", "Numba", "kernels", "plugins", "configs"}
    assert done.returncode == 1


def test_without_any_library_it_still_says_what_it_can(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", ALONE], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    lines = lines_of(done.stdout)
    assert lines["PyTorch"].startswith("!unknown")
    assert lines["libraries"] == "!unknown: ModuleNotFoundError: No module named packaging"
    assert brushexp.__version__ in lines["brushexp"]
    assert done.returncode == 1


@pytest.fixture
def installed(monkeypatch):
    """Return a function that fakes an installation with given requirements and installed versions."""

    def install(requirements: list[str], versions: dict[str, str]) -> None:
        extras = SimpleNamespace(get_all=lambda name: ["film", "cluster", "elsewhere", "dev"])
        found = SimpleNamespace(requires=requirements, metadata=extras)
        monkeypatch.setattr(doctor, "distribution", lambda name: found)

        def version(name: str) -> str:
            if name not in versions:
                raise doctor.PackageNotFoundError(name)
            return versions[name]

        monkeypatch.setattr(doctor, "version", version)

    return install


def test_missing_and_old_libraries_and_extras_come_with_the_line_that_installs_them(installed):
    needed = ["arrays>=2", "kernels; python_version >= '3'", "old; python_version < '3'", 'films>=3; extra == "film"']
    needed += ['jobs; extra == "cluster"', 'queues; extra == "cluster"', 'linter; extra == "dev"']
    needed += ["odd; python_version < '3' and extra == 'elsewhere'"]
    installed(needed, {"arrays": "2.1rc1", "kernels": "1", "films": "3.0", "queues": "1"})
    assert doctor._libraries() == "all required libraries are installed"
    assert doctor._extras() == (["film"], ["cluster"])
    assert doctor._missing_extras() == "cluster; to add all: pip install 'brushexp[cluster]'"
    installed(needed, {"arrays": "1.9", "films": "2.9"})
    with pytest.raises(doctor.Broken, match=r"pip install 'arrays>=2' 'kernels'$"):
        doctor._libraries()
    assert doctor._extras() == ([], ["cluster", "film"])


def test_it_takes_no_settings(tmp_path):
    done = typed("doctor", "seed=3", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "brushexp: doctor takes no settings; type: brushexp doctor\n"
