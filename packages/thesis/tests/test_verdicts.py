"""Test that claims are judged by paired differences, refer to settings of their studies, and appear on the page."""

import json
import math
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from brushexp_studies.paired import paired_differences
from brushexp_thesis import verdicts
from brushexp_thesis.claims import Claim, read_claims
from brushexp_thesis.evidence import detectable_effect, p_of_mean
from brushexp_thesis.judgements import evidence_row, judge
from brushexp_thesis.study_records import Study, studies_in
from brushexp_thesis.verdicts import SHIPPED_PAINTINGS, numbers_of_settings
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from refusals import refuses
from scipy.stats import binom, t
from sweeps import note
from test_paired import PICTURES, A, C, gap, make_study

from brushexp.system.files import write_json
from brushexp.system.reading import read_text, yaml_of
from brushexp.system.words import conf_folders

RECORDS = Path(__file__).parents[3] / "docs" / "ablations"
CLAIMS = """
mine:
  - {says: o1 is better, section: 6.3, setting: order=o1, against: order=o0, metric: psnr, expects: better}
  - {says: and as fast, section: ours, setting: order=o1, against: order=o0, metric: cpu_seconds, expects: no worse}
other:
  - {says: something else, section: 9, setting: a=1, against: a=2, metric: psnr, expects: open}
  - {says: what nobody measures, section: 8, cannot: it would need people}
  - {says: what nobody has run, section: 8, needs: a week of a GPU would answer it}
"""
TYPED = ["image=/x/y/a.png", "hydra/sweeper=optuna", 'style.image="/x/my photo.jpg"', 'loss=["/x/a","b"]']
TYPED += ["hydra.sweeper.settings=['a=1 renderer.checkpoint=/a/b/n.safetensors','a=2']"]
TYPED += ['hydra.sweeper.pictures=["/p/a, b.jpg","thesis12"]', 'hydra.sweeper.pictures=["/p/a b.jpg","thesis12"]']
SHORT = ["experiment=mine", "image=a.png", "hydra/sweeper=optuna", "style.image=my photo.jpg", "loss=[a,b]"]
SHORT += ["hydra.sweeper.settings=['a=1 renderer.checkpoint=n.safetensors','a=2']"]
SHORT += ['hydra.sweeper.pictures=["a, b.jpg",thesis12]', "pictures=a b.jpg,thesis12"]
GAINED = [a + gain for a, gain in zip(A, (0.5, 0.6, 0.4, 0.5), strict=True)]
CLEAR, WORSE, SAME = (0.5, 0.6, 0.4, 0.5), (-0.5, -0.6, -0.4, -0.5), (0.01, -0.01, 0.02, -0.02)


def claim(expects, **fields):
    return Claim(
        **{"says": "", "section": "", "setting": "x", "against": "y", "metric": "psnr"} | fields, expects=expects
    )


def make_sweep(folder, typed=(), jobs=12, **options):
    """Write a sweep of experiment=mine with the runs of `make_study`."""
    (folder / ".hydra").mkdir(parents=True)
    write_json(folder / ".hydra" / "jobs.json", {"typed": [*typed, "experiment=mine"], "jobs": [[]] * jobs})
    return make_study(folder, **options)


@pytest.mark.parametrize(("expects", "gains", "verdict"), [
    ("better", CLEAR, "holds"), ("better", WORSE, "does not hold"), ("better", SAME, "does not hold"),
    ("no worse", CLEAR, "holds"), ("no worse", WORSE, "does not hold"), ("no worse", SAME, "holds"),
    ("no worse", (0.085, 0.085, -0.025, -0.025), "holds"), ("no worse", (-0.05, -0.06, -0.04, -0.05), "holds"),
    ("better", (-0.12, 0.0, -0.1, 0.02), "does not hold"), ("open", (-0.12, 0.0, -0.1, 0.02), "not decided"),
    ("better", (0.05, 0.06, 0.04, 0.05), "does not hold"), ("open", (-0.05, -0.06, -0.04, -0.05), "no difference"),
    ("open", CLEAR, "better"), ("open", SAME, "no difference"),
    ("better", (0.5,), "not decided"), ("no worse", (0.5, -0.4, 0.3, 0.1), "not decided"),
    ("better", (1.0, 1.0, 1.0, -1.0, -1.0, -1.0), "depends on the picture"),
    ("better", (0.2, 0.2, 0.2, -0.2, -0.2, -0.2, *9 * (0.0,)), "does not hold"),
])  # fmt: skip
def test_a_claim_is_judged_by_its_difference(expects, gains, verdict):
    assert claim(expects).answer(gap(*gains))[0] == verdict


@pytest.mark.parametrize(("ratio", "verdict"), [(3.0, "holds"), (1.5, "does not hold"), (2.0, "not decided")])
def test_at_least_so_many_times(ratio, verdict):
    gains = [math.log(ratio) + noise for noise in (0.01, -0.01, 0.02, -0.02)]
    one = claim("better", metric="seconds", at_least=2.0)
    assert one.answer(gap(*gains, metric="seconds"))[0] == verdict


@pytest.mark.parametrize(("expects", "gains", "stated"), [
    ("better", CLEAR, (0, math.inf)), ("better", WORSE, (-math.inf, 0.1)), ("better", SAME, (-math.inf, 0.1)),
    ("no worse", CLEAR, (-0.1, math.inf)), ("no worse", WORSE, (-math.inf, 0)), ("open", WORSE, (-math.inf, 0)),
])  # fmt: skip
def test_a_verdict_has_the_p_of_what_it_states(expects, gains, stated):
    assert claim(expects).answer(gap(*gains))[1] == stated


def test_a_claim_of_two_settings_beside_the_reference_has_an_interval_of_all_pairs():
    index = pd.MultiIndex.from_product([["a=1", "a=2", "a=3", "a=4"], ["x", "y", "z"]], names=["option", "picture"])
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"psnr": 30 + rng.normal(size=12)}, index)
    study = Study("s", (), table, 12, 12, 12, "")

    def half(setting, against):
        one = study.difference(claim("better", setting=setting, against=against))
        values = table["psnr"][setting].to_numpy() - table["psnr"][against].to_numpy()
        return one.high - one.mean, values.std(ddof=1) / math.sqrt(3)

    for setting, against, comparisons in (("a=2", "a=1", 3), ("a=1", "a=4", 3), ("a=2", "a=3", 6), ("a=4", "a=2", 6)):
        width, error = half(setting, against)
        assert width == pytest.approx(t.ppf(1 - 0.05 / comparisons / 2, 2) * error)


def study_of(gains, unit="picture", name="s"):
    """Return a study in which the second setting has the given ``gains`` over the first."""
    index = pd.MultiIndex.from_product([["y=1", "x=1"], sorted(gains)], names=["option", unit])
    table = pd.DataFrame({"psnr": [30.0] * len(gains) + [30 + gains[one] for one in sorted(gains)]}, index)
    return Study(name, (), table, 0, 0, 0, "")


def test_claims_of_a_page_are_corrected_together():
    """The p-values are corrected for the number of claims on a page.

    A single claim with a p-value of 0.013 is decided, but none of eight such claims on one page is.
    """
    studies = {"s": study_of(dict(zip("abcd", (0.3, 0.6, 0.9, 0.5), strict=True)))}
    one = claim("better", study="s", setting="x=1", against="y=1")
    (alone,) = judge([one], studies)
    assert alone.p == pytest.approx(p_of_mean([0.3, 0.6, 0.9, 0.5], (0, math.inf)))
    assert (alone.verdict, alone.note) == ("holds", "")
    eight = judge([one] * 8, studies)
    assert {two.verdict for two in eight} == {"not decided"}
    assert eight[0].p == pytest.approx(8 * alone.p)
    assert eight[0].note == "alone: holds"


def test_a_claim_of_a_gain_that_is_shown_to_be_none_fails_by_the_p_of_that_alone():
    gains = dict(zip("abcdef", (0.06, 0.05, 0.07, 0.06, 0.05, 0.07), strict=True))
    (one,) = judge([claim("better", study="s", setting="x=1", against="y=1")], {"s": study_of(gains)})
    assert (one.difference.verdict, one.verdict) == ("same", "does not hold")
    assert one.p == pytest.approx(p_of_mean(list(gains.values()), (-math.inf, 0.1)))


def test_an_answer_that_depends_on_the_picture_has_an_error_rate_and_is_corrected_with_all_others():
    gains = dict(zip("abcdefghijkl", (*5 * (1.0,), *5 * (-1.0,), 0.0, 0.0), strict=True))
    one = claim("better", study="s", setting="x=1", against="y=1")
    (alone,) = judge([one], {"s": study_of(gains)})
    assert (alone.verdict, alone.p_ranks) == ("depends on the picture", None)
    assert alone.p == pytest.approx(2 * binom.sf(4, 12, 0.05))
    few = dict(zip("abcdefghijkl", (*3 * (1.0,), *3 * (-1.0,), *6 * (0.0,)), strict=True))
    both = judge([claim("open", study="s", setting="x=1", against="y=1")] * 2, {"s": study_of(few)})
    assert [two.note for two in both] == ["alone: depends on the picture"] * 2
    assert {two.verdict for two in both} == {"not decided"}


def test_a_claim_that_a_study_could_answer_is_not_run_and_says_what_the_study_needs():
    gains = dict.fromkeys("abcdef", 0.5)
    one = claim("better", study="s", setting="x=1", against="y=1", needs="a faster machine would answer it")
    (judged,) = judge([one], {"s": study_of(gains)})
    assert (judged.verdict, judged.p) == ("not run", None)
    assert judged.remark == "Not run: a faster machine would answer it."


def test_a_claim_that_cannot_be_answered_says_why_and_weighs_upon_no_other():
    studies = {"s": study_of(dict.fromkeys("abcdef", 0.5) | {"a": 0.6})}
    asked = claim("better", study="s", setting="x=1", against="y=1", remark="r", after_results=True)
    mute = claim("better", study="s", setting="x=1", against="y=1", cannot="it would need more")
    nowhere = Claim(study="none", says="", section="", cannot="nobody knows")
    judged = judge([asked, mute, nowhere, claim("better", study="t")], studies)
    assert [one.verdict for one in judged] == ["holds", *2 * ["cannot be answered here"], "not run"]
    assert judged[0].note == "post hoc"
    assert [one.remark for one in judged[:2]] == ["r.", "Cannot be answered here: it would need more."]
    assert judged[0].p == judge([asked], studies)[0].p
    assert judged[1].p is None
    assert judged[1].difference is not None


def test_four_of_five_studies_find_the_smallest_detectable_effect():
    rng = np.random.default_rng(0)
    draws = rng.normal(size=(2000, 12))
    effect = np.mean([detectable_effect(gap(*draw)) for draw in draws[:100]])
    half = t.ppf(0.975, 11) * draws.std(axis=1, ddof=1) / math.sqrt(12)
    found = np.mean(draws.mean(axis=1) + effect > half)
    assert found == pytest.approx(0.8, abs=0.05)


def test_ranks_that_differ_from_student_are_remarked():
    gains = dict(zip("abcdefgh", (-0.3, -0.4, -0.2, -0.35, -0.25, -0.3, -0.45, 2.0), strict=True))
    (one,) = judge([claim("open", study="s", setting="x=1", against="y=1")], {"s": study_of(gains)})
    assert (one.verdict, one.note) == ("not decided", "")
    gains |= dict(zip("ijklmn", 6 * (-0.3,), strict=True))
    (one,) = judge([claim("open", study="s", setting="x=1", against="y=1")], {"s": study_of(gains)})
    assert one.verdict == "not decided"
    assert one.note.startswith("ranks differ: p 0.0")
    row = evidence_row(one, {"a", "b", "c", "h"})
    assert (row["median"].split()[0], row["better, worse"]) == ("-0.30", "1, 13 of 14")
    assert row["paintings"].startswith("+0.28 [")
    assert row["photographs"].startswith("-0.32 [-0.35, ")
    assert "paintings" not in evidence_row(one, {"a", "b"})
    (seeds,) = judge([claim("open", study="s", setting="x=1", against="y=1")], {"s": study_of(gains, "seed")})
    assert "photographs" not in evidence_row(seeds, {"a", "b", "c", "h"})


def studies_named(name):
    """Return the paths of the shipped files that define a study."""
    return [path for folder in conf_folders() for path in folder.glob(f"experiment/{name}.yaml")]


def options_of(study):
    """List a study's settings as Hydra passes them to jobs, such as ``critic=True``."""
    (path,) = studies_named(study)
    sweeper = yaml_of(read_text(path, ""))["hydra"]["sweeper"]
    parser = OverridesParser.create()
    words = (parser.parse_overrides(shlex.split(setting)) for setting in sweeper["settings"])
    return {" ".join(job) for some in words for job in BasicSweeper.split_arguments(some, None)[0]}


@pytest.mark.parametrize("study", [name for name, listed in read_claims().items() if listed[0].setting])
def test_a_study_has_the_settings_of_its_claims(study):
    listed = bool(studies_named(study))
    options = options_of(study) if listed else set(studies_in([RECORDS], RECORDS)[study].table.index.levels[0])
    for one in read_claims()[study]:
        assert {one.setting, one.against} <= options, one.says


def test_the_shipped_paintings_are_those_of_the_set_that_is_held_out():
    lines = yaml_of(
        read_text(
            next(one for one in conf_folders() if "thesis" in one.parent.name) / "pictures" / "held_out_paintings.yaml",
            "",
        ),
        list,
    )
    assert {Path(name).name for line in lines for name in line} < set(yaml_of(read_text(SHIPPED_PAINTINGS, ""), list))


def test_a_record_of_another_program_has_its_command_and_question(tmp_path):
    table = pd.DataFrame({"cpu_seconds": [1.0, 2.0]}, pd.MultiIndex.from_tuples([("a=1", "0"), ("a=2", "0")]))
    table = table.rename_axis(["option", "seed"])
    Study("b", ("python", "b.py"), table, 2, 2, 2, "cheap", "Why?").record(tmp_path / "b.csv")
    one = studies_in([tmp_path], tmp_path)["b"]
    assert (one.command, one.question) == ("python b.py", "Why?")


def test_a_study_of_several_versions_says_so_on_the_page_and_in_its_record(tmp_path, run_task):
    make_sweep(tmp_path / "studies" / "a", TYPED, psnr=(A, GAINED, C))
    assert studies_in([tmp_path / "studies"], tmp_path)["mine"].provenance == ""
    for number, path in enumerate((tmp_path / "studies" / "a").rglob("metrics.json")):
        write_json(path, json.loads(path.read_text()) | {"provenance": {"numba": str(min(number, 1))}})
    (tmp_path / "claims.yaml").write_text(CLAIMS)
    words = (f"claims={tmp_path}/claims.yaml", f"page={tmp_path}/docs/ablations.md")
    run_task(verdicts, "task=verdicts", f"runs={tmp_path}/studies", *words)
    assert "These runs differ in Numba (" in (tmp_path / "docs" / "ablations.md").read_text().replace("\\", "")
    assert studies_in([tmp_path / "docs" / "ablations"], tmp_path)["mine"].provenance.startswith("These runs differ in")


def test_the_page_has_verdicts_plots_and_costs_of_what_was_run(tmp_path, run_task):
    typed = [*TYPED, "hydra/launcher=a", "hydra.searchpath=[file:///x/conf]"]
    make_sweep(tmp_path / "studies" / "a", typed, 0, psnr=(A, GAINED, C), cpu_seconds=900.0)
    (tmp_path / "claims.yaml").write_text(CLAIMS)
    words = (f"claims={tmp_path}/claims.yaml", f"page={tmp_path}/docs/ablations.md")
    result = run_task(verdicts, "task=verdicts", f"runs={tmp_path}/studies", *words)
    text = (tmp_path / "docs" / "ablations.md").read_text()
    assert (result["holds"], result.get("does_not_hold"), result["not_run"]) == (2, None, 2)
    assert "| claim | verdict | effect | power | p |" in text
    assert "| [o1 is better](#mine) (6.3) | holds | PSNR, dB +0.50 [" in text
    numbers = pd.read_csv(tmp_path / "docs" / "ablations" / "verdicts.csv")
    assert numbers["compared"].tolist() == ["order=o1 against order=o0"] * 2
    assert numbers["better, worse"].tolist() == ["4, 0 of 4", "0, 0 of 4"]
    settings = pd.read_csv(tmp_path / "docs" / "ablations" / "settings.csv")
    settings = settings[settings["metric"] == "PSNR, dB"]
    assert settings["change"].tolist()[0] == "reference"
    second = settings.iloc[1]
    assert second["setting"] == "order=o1"
    assert second["mean"] == pytest.approx(np.mean(GAINED), abs=0.01)
    assert float(second["change"]) == pytest.approx(0.5)
    assert second["low"] < float(second["change"]) < second["high"]
    assert f"`brushexp {shlex.join(SHORT)}`" in text
    assert "4 pictures; 12 runs; 3.00 CPU hours: [mine.csv](ablations/mine.csv)." in text
    assert "![Differences of mine](ablations/mine.png)" in text
    assert (tmp_path / "docs" / "ablations" / "mine.png").is_file()
    assert "Verdicts on 5 claims: holds 2, not run 2, cannot be answered here 1." in text
    assert "| what nobody measures | 8 | it would need people |" in text
    assert "| something else | 9 | brushexp experiment=other |" in text
    assert "| what nobody has run | 8 | a week of a GPU would answer it |" in text
    assert "## other" not in text
    assert "A claim of *no worse* holds if the interval allows no loss that matters" in " ".join(text.split())
    message = "no sweep of an experiment= found; run one first"
    refuses(message, run_task, verdicts, "task=verdicts", f"runs={tmp_path}/docs")


@pytest.mark.parametrize(("noted", "cost"), [
    ({"cpu_seconds": 900.0, "seconds_total": 300.0}, "3.00 CPU hours"),
    ({"seconds_total": 300.0}, "1.00 hours, CPU time not recorded"),
    ({"seconds_total": None, "seconds": 600.0}, "2.00 hours, CPU time not recorded"),
])  # fmt: skip
def test_what_a_study_took_is_told_by_what_its_runs_noted(tmp_path, noted, cost):
    folder = make_sweep(tmp_path, TYPED, **noted)
    assert studies_in([tmp_path], tmp_path)["mine"].cost == cost
    if "cpu_seconds" in noted:
        note(folder, 5, cpu_seconds=None)
        assert studies_in([tmp_path], tmp_path)["mine"].cost == "2.75 CPU hours for 11 of them"


def test_a_study_of_other_numbers_than_quality_has_its_table():
    index = pd.MultiIndex.from_product([["engine=disc", "engine=fluid"], ["0", "1", "2"]], names=["option", "seed"])
    table = pd.DataFrame({"strokes_per_second": [10.0, 11.0, 12.0, 20.0, 21.0, 25.0]}, index)
    rows = numbers_of_settings(Study("mine", (), table, 6, 6, 6, ""), paired_differences(table))
    assert (rows[0]["setting"], rows[0]["change"]) == ("engine=disc", "reference")
    assert (rows[1]["setting"], rows[1]["better on"], rows[1]["of"]) == ("engine=fluid", "3", "3")


def test_an_incomplete_claim_is_explained(tmp_path):
    for wrong, message in (
        ("s: [{says: x, section: 1}]", "entry 1 of s has no setting and no against and no metric and no expects; give"),
        ("s: [{says: x, section: 1, cannot: y, metric: psnr}]", "has no setting and no against and no expects; give"),
        (CLAIMS.replace("psnr", "nope"), "unknown metric"),
        (CLAIMS.replace("psnr", "[psnr]"), "entry 1 of mine: metric: "),
        (CLAIMS.replace("order=o1", "order=o)"), r"claims=.*: 'order=o\)' is not a setting of a study"),
        ("hello", "claims=.*: not a YAML mapping"),
        (CLAIMS.replace("expects: better", "expects: better, at_least: .nan"), "at_least=nan; give a ratio above 0"),
    ):
        (tmp_path / "claims.yaml").write_text(wrong)
        refuses(message, read_claims, tmp_path / "claims.yaml")


@pytest.mark.parametrize(("typed", "command"), [
    ("data=[{here}/data/brushes]", "data=[data/brushes]"),
    ("data=[data/brushes,../brushes]", "data=[data/brushes,brushes]"),
    ("data={here}/data/set_${{engine.window}}", "data=data/set_${{engine.window}}"),
    ("renderer.checkpoint=/elsewhere/n.safetensors", "renderer.checkpoint=n.safetensors"),
    ("hydra.sweeper.settings=['a=1 renderer.checkpoint={here}/w/n.safetensors','a=2']",
     "hydra.sweeper.settings=['a=1 renderer.checkpoint=w/n.safetensors','a=2']"),
])  # fmt: skip
def test_a_command_keeps_the_folders_below_the_one_it_is_run_in(tmp_path, monkeypatch, typed, command):
    monkeypatch.chdir(tmp_path)
    make_sweep(tmp_path, [typed.format(here=tmp_path)])
    assert studies_in([tmp_path], tmp_path)["mine"].words == ("experiment=mine", command.format(here=tmp_path))


def test_a_page_is_written_anew_from_its_records_and_a_larger_study_replaces_one(tmp_path, run_task):
    for name, pictures in (("few", 3), ("more", 4)):
        psnr = [values[:pictures] for values in (A, GAINED, C)]
        make_sweep(tmp_path / name, psnr=psnr, units=PICTURES[::-1][:pictures], cpu_seconds=900.0)
    (tmp_path / "claims.yaml").write_text(CLAIMS)

    def page_of(*runs):
        page = tmp_path / "docs" / "ablations.md"
        claims = f"claims={tmp_path}/claims.yaml"
        run_task(verdicts, "task=verdicts", f"runs=[{','.join(runs)}]", claims, f"page={page}")
        return [line for line in page.read_text().splitlines() if not line.startswith("Written by")]

    few = page_of(f"{tmp_path}/few")
    record = tmp_path / "docs" / "ablations"
    plot = (record / "mine.png").read_bytes()
    assert (record / "mine.csv").read_text().splitlines()[1].startswith("option,picture,psnr")
    assert page_of(str(record)) == few
    assert (record / "mine.png").read_bytes() == plot
    more = page_of(str(record), f"{tmp_path}/more")
    assert more != few
    assert page_of(str(record)) == more == page_of(f"{tmp_path}/few", str(record), f"{tmp_path}/more")


def test_an_unfinished_rerun_replaces_no_complete_study(tmp_path):
    for name, rows in (("all", (A, A, C)), ("part", (A, A))):
        make_sweep(tmp_path / name, psnr=rows)
    assert studies_in([tmp_path / "part"], tmp_path)["mine"].n_finished == 8
    assert studies_in([tmp_path / "all", tmp_path / "part"], tmp_path)["mine"].n_finished == 12


def test_a_file_that_only_looks_like_a_record_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("# {}\n1,2\n")
    refuses("is not a record of a study", studies_in, [tmp_path], tmp_path)
    (tmp_path / "a.csv").write_text("option,picture\n")  # other tables are ignored
    refuses("no sweep of", studies_in, [tmp_path], tmp_path)
