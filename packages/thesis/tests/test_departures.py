"""Test that the list of departures contains exactly those settings that differ from the thesis."""

from brushexp_thesis import departures as departures_task
from brushexp_thesis.departures import THESIS, departures
from omegaconf import OmegaConf
from refusals import refuses

from brushexp.pages.run_page import list_settings
from brushexp.system.reading import read_text, yaml_of
from brushexp.tasks import paint

ROWS = yaml_of(read_text(THESIS, ""), list)
OF_THE_THESIS = {row["key"]: row["value"] for row in ROWS if row["value"] != []}


def listed(cfg) -> dict[str, str]:
    """Map the key of each setting that departs from the thesis to its value in the run."""
    settings = list_settings(OmegaConf.to_container(cfg, resolve=True, enum_to_str=True), [])
    return {row["setting"]: row["this run"] for row in departures({key: value for key, value, _ in settings})}


def test_a_run_that_follows_the_thesis_differs_only_where_no_setting_can():
    typed = {key: value[0] if isinstance(value, list) else value for key, value in OF_THE_THESIS.items()}
    texts = {key: "null" if value is None else str(value).lower() for key, value in typed.items()}
    texts |= {"renderer": "inverse_vgg", "optimizer.name": "Adam", "optimizer.options.betas": "[0.9, 0.999]"}
    assert texts["blend"] == "topk"
    always = {row["key"] for row in ROWS if row["value"] == []}
    assert {row["setting"] for row in departures(texts)} == always
    one = next(row for row in departures(texts | {"optimizer.lr": "0.02"}) if row["setting"] == "optimizer.lr")
    assert one == {"setting": "optimizer.lr", "thesis": "0.01", "this run": "0.02", "where": "6.3"}


def test_the_experiment_has_few_and_every_row_names_what_a_run_can_have(config):
    rows = listed(config("experiment=thesis"))
    assert (rows["steps_per_stroke"], rows["loss.perceptual.backbone"]) == ("50.0", "effl0")
    frozen = {"optimizer.units.position", "optimizer.units.opacity", "order.until", "order.every", "init.jitter"}
    assert not {*frozen, "renderer.project"} & rows.keys()
    assert "steps_per_stroke" not in listed(config("experiment=thesis_full"))
    assert listed(config("experiment=thesis", "order.until=0.5"))["order.until"] == "0.5"
    cfg = config("experiment=thesis")
    for row in ROWS:
        assert row["key"].split(".")[0] in cfg, row
        assert row["source"], row
        assert "thesis" in row or row["value"] != [], row


def test_the_task_lists_them_of_paintings(run_task, tmp_path):
    run_task(paint, "image=coffee", "look=plain", "resolution=32", "strokes=12", "steps=2", "frames=0", "report=false")
    result = run_task(departures_task, "task=departures", f"runs=[{tmp_path}]")
    text = (tmp_path / "departures.md").read_text()
    assert f"{result['departures']} settings differ." in text
    assert "| loss.width | width | absent | 6.24 |" in text
    (tmp_path / "catalogue.h5").unlink()
    words = "no finished painting found; set runs= to folders that contain one"
    refuses(words, run_task, departures_task, "task=departures", f"runs=[{tmp_path}]")
