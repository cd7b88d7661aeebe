"""The page of a run that follows a published procedure lists every setting in which it differs, and nothing else."""

from brushexp_thesis.followed import PROCEDURES, departures
from omegaconf import OmegaConf

from brushexp.pages.run_page import _departures, _settings
from brushexp.system.reading import read_text, yaml_of

ROWS = yaml_of(read_text(PROCEDURES["thesis"], ""), list)
OF_THE_THESIS = {row["key"]: row["value"] for row in ROWS if row["value"] != []}


def listed(cfg) -> dict[str, str]:
    """Key -> what the run has instead."""
    found = _departures(_settings(OmegaConf.to_container(cfg, resolve=True, enum_to_str=True), []))
    return {} if found is None else {row["key"]: row["run"] for row in found["rows"]}


def test_a_run_that_is_the_thesiss_differs_only_where_the_thesis_is_silent_or_no_setting_does_as_it_did():
    typed = {key: value[0] if isinstance(value, list) else value for key, value in OF_THE_THESIS.items()}
    texts = {key: "null" if value is None else str(value).lower() for key, value in typed.items()}
    texts |= {"renderer": "inverse_vgg", "optimizer.name": "Adam", "optimizer.options.betas": "[0.9, 0.999]"}
    assert texts["blend"] == "topk"
    always = {row["key"] for row in ROWS if row["value"] == []}
    assert {row["key"] for row in departures("thesis", texts)} == always
    one = next(row for row in departures("thesis", texts | {"optimizer.lr": "0.02"}) if row["key"] == "optimizer.lr")
    assert one == {"key": "optimizer.lr", "wanted": "0.01", "run": "0.02", "source": "6.3"}


def test_the_experiment_lists_what_is_left_and_other_runs_nothing(config):
    found = listed(config("experiment=thesis"))
    assert found["steps_per_stroke"] == "50.0"
    assert found["loss.perceptual.backbone"] == "effl0"
    frozen = {
        "optimizer.units.position",
        "optimizer.units.opacity",
        "order.until",
        "order.every",
        "init.jitter",
        "renderer.project",
    }
    assert not frozen & found.keys()
    assert "steps_per_stroke" not in listed(config("experiment=thesis_full"))
    assert listed(config("experiment=thesis", "order.until=0.5"))["order.until"] == "0.5"
    assert listed(config()) == {}


def test_every_row_names_what_a_run_can_have(config):
    cfg = config("experiment=thesis")
    for row in ROWS:
        assert row["key"].split(".")[0] in cfg, row
        assert row["source"], row
        assert "thesis" in row or row["value"] != [], row
