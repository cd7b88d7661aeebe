"""Every named study composes, and its jobs can be told apart."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from brushexp.registry import build

ROOT = Path(__file__).parents[1]
STUDIES = sorted(path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml"))


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_composes_and_asks_a_question(study):
    text = (ROOT / "conf" / "experiment" / f"{study}.yaml").read_text().splitlines()
    assert text[0] == "# @package _global_"
    assert "?" in text[1]
    assert f"experiment={study}" in text[1]
    with initialize_config_dir(version_base="1.3", config_dir=str(ROOT / "conf")):
        cfg = compose("config", overrides=[f"experiment={study}"])
    for node in cfg.get("loss", {}).values():  # a task without paintings has none
        build(node)
