"""Every command that the documentation shows can be typed: its task, plugins, keys and values are there."""

import re
import shlex

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from program import ROOT

from brushexp.cli.program import expand_arguments
from brushexp.config.compose import composed

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SHOWN = {
    command: f"{page.name}: {command}"
    for page in PAGES
    for command in re.findall(r"^ {4}brushexp (.*?)(?:  +#.*)?$", page.read_text(), re.MULTILINE)
}


def first_of(override):
    """The first value of a sweep, or the lower end of an interval."""
    return override.value().start if override.is_interval_sweep() else next(override.sweep_string_iterator())


@pytest.mark.parametrize("command", SHOWN, ids=SHOWN.values())
def test_a_command_that_is_shown_composes(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").touch()
    words = [word for word in shlex.split(command, comments=True) if word not in ("-m", "--multirun", "--help")]
    flags = ["-m"] * ("-m" in command.split())
    overrides = OverridesParser.create().parse_overrides(
        [word for word in expand_arguments([*flags, *words]) if not word.startswith("-")]
    )
    composed(
        [f"{one.get_key_element()}={first_of(one)}" if one.is_sweep_override() else one.input_line
         for one in overrides if not one.key_or_group.startswith("hydra.")]
    )  # fmt: skip
