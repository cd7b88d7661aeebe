"""Tests that the CI workflow's commands, files and versions exist, and that issue templates are short."""

import re
import shlex
import tomllib

import yaml
from program import ROOT

WORKFLOW = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
JOBS = WORKFLOW["jobs"]
COMMANDS = [line for job in JOBS.values() for step in job["steps"] for line in step.get("run", "").splitlines()]
LONGEST_TEMPLATE = 15  # lines


def test_the_workflow_starts_on_changes_and_runs_what_has_to_pass_before_a_merge():
    assert {"push", "pull_request"} == set(WORKFLOW[True])  # YAML 1.1 reads "on" as true
    assert "bash .ci/run" in COMMANDS
    assert "brushexp doctor" in COMMANDS
    assert {job.get("needs", "wheel") for job in JOBS.values()} <= set(JOBS)
    for job in JOBS.values():
        assert job["timeout-minutes"]
        assert all(("run" in step) != ("uses" in step) for step in job["steps"])


def test_the_systems_have_the_versions_of_python_that_the_program_allows():
    matrix = JOBS["systems"]["strategy"]["matrix"]
    assert matrix["os"] == ["ubuntu-latest", "macos-latest", "windows-latest"]
    lowest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert f">={matrix['python'][0]}" == lowest
    assert all(isinstance(version, str) for version in matrix["python"])  # 3.10 would be 3.1


def test_files_and_libraries_that_the_commands_name_are_there():
    words = [word for line in COMMANDS for word in shlex.split(line)]
    files = [word for word in words if re.fullmatch(r"[\w./-]+\.(py|txt)", word) or word.startswith(".ci/")]
    assert {".ci/run", ".ci/part_of_tests.py", "constraints.txt"} <= {*files}
    assert not [word for word in files if not (ROOT / word).is_file()]
    (line,) = [line for line in COMMANDS if "pip install" in line and "pytest" in line]
    pinned = {line.partition("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines()}
    assert {word for word in line.split() if word.startswith("pytest")} <= pinned
    text = (ROOT / ".ci" / "part_of_tests.py").read_text()
    names = re.findall(r'"(\w+)"', text.partition("NAMES = ")[2].partition("\n")[0])
    assert names
    assert not [name for name in names if not (ROOT / "tests" / f"test_{name}.py").is_file()]


def test_templates_are_short_and_ask_for_what_a_report_needs():
    templates = [*(ROOT / ".github").rglob("*.md")]
    assert len(templates) == 3
    assert all(len(path.read_text().splitlines()) <= LONGEST_TEMPLATE for path in templates)
    assert "brushexp doctor" in (ROOT / ".github" / "ISSUE_TEMPLATE" / "bug.md").read_text()
