"""Claims are judged by paired differences, painters by means of the same pictures, runs by what the thesis says."""

import math
import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from browser import NARROW
from brushexp_studies.paired import paired_differences
from brushexp_thesis import departures as departures_task
from brushexp_thesis import leaderboard as task
from brushexp_thesis import verdicts
from brushexp_thesis.claims import Claim, read_claims
from brushexp_thesis.departures import THESIS, departures
from brushexp_thesis.evidence import holm, median_of, p_of_mean, p_of_ranks
from brushexp_thesis.halves import BusyHalf, FlatHalf
from brushexp_thesis.judgements import evidence_row, judge
from brushexp_thesis.leaderboard import write_leaderboard_page, write_standings_plot
from brushexp_thesis.published import read_published
from brushexp_thesis.standings import entries_of, sections_of
from brushexp_thesis.standings_tables import at_equal_seconds, by_picture, table_cells
from brushexp_thesis.study_records import Study, as_listed, studies_in
from brushexp_thesis.verdicts import SHIPPED_PAINTINGS, study_rows
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf
from PIL import Image
from program import ended
from refusals import refuses
from scipy import stats
from scipy.stats import bootstrap, t, ttest_1samp, wilcoxon
from sweeps import make_run, note, read_csv
from test_studies import PICTURES, A, C, gap, make_study

from brushexp.config.vocabulary import SHIPPED
from brushexp.pages.run_page import list_settings
from brushexp.plugins.metric.base import Comparison
from brushexp.results.runs import gather
from brushexp.system.files import write_json, write_picture, write_text
from brushexp.system.reading import read_text, yaml_of
from brushexp.tasks import paint

RECORDS = Path(__file__).parents[3] / "docs" / "ablations"
CLAIMS = """
mine:
  - {says: o1 is better, section: 6.3, setting: order=o1, against: order=o0, metric: psnr, expects: better}
  - {says: and as fast, section: ours, setting: order=o1, against: order=o0, metric: cpu_seconds, expects: no worse}
other:
  - {says: something else, section: 9, setting: a=1, against: a=2, metric: psnr, expects: open}
  - {says: what nobody measures, section: 8, cannot: it would need people}
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
    """A sweep of experiment=mine with the runs of `make_study`."""
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
])  # fmt: skip
def test_a_claim_is_judged_by_its_difference(expects, gains, verdict):
    assert claim(expects).answer(gap(*gains))[0] == verdict


@pytest.mark.parametrize(("ratio", "verdict"), [(3.0, "holds"), (1.5, "does not hold"), (2.0, "not decided")])
def test_at_least_so_many_times(ratio, verdict):
    gains = [math.log(ratio) + noise for noise in (0.01, -0.01, 0.02, -0.02)]
    one = claim("better", metric="seconds", at_least=2.0)
    assert one.answer(gap(*gains, metric="seconds"))[0] == verdict


@pytest.mark.parametrize(("expects", "gains", "stated"), [
    ("better", CLEAR, (0, math.inf)), ("better", WORSE, (-math.inf, 0)), ("better", SAME, (-0.1, 0.1)),
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
    """A study whose second setting gains so much over the first."""
    index = pd.MultiIndex.from_product([["y=1", "x=1"], sorted(gains)], names=["option", unit])
    table = pd.DataFrame({"psnr": [30.0] * len(gains) + [30 + gains[one] for one in sorted(gains)]}, index)
    return Study(name, (), table, 0, 0, 0, "")


def test_claims_of_a_page_are_corrected_together():
    """Eight claims whose p is 0.013 are each decided alone, and none of them beside seven others."""
    studies = {"s": study_of(dict(zip("abcd", (0.3, 0.6, 0.9, 0.5), strict=True)))}
    one = claim("better", study="s", setting="x=1", against="y=1")
    (alone,) = judge([one], studies)
    assert alone.p == pytest.approx(p_of_mean([0.3, 0.6, 0.9, 0.5], (0, math.inf)))
    assert (alone.verdict, alone.remarks) == ("holds", "")
    eight = judge([one] * 8, studies)
    assert {two.verdict for two in eight} == {"not decided"}
    assert eight[0].p == pytest.approx(8 * alone.p)
    assert eight[0].remarks == "alone: holds"


def test_a_claim_that_cannot_be_answered_says_why_and_weighs_upon_no_other():
    studies = {"s": study_of(dict.fromkeys("abcdef", 0.5) | {"a": 0.6})}
    asked = claim("better", study="s", setting="x=1", against="y=1", remark="r", after_results=True)
    mute = claim("better", study="s", setting="x=1", against="y=1", cannot="it would need more")
    nowhere = Claim(study="none", says="", section="", cannot="nobody knows")
    judged = judge([asked, mute, nowhere, claim("better", study="t")], studies)
    assert [one.verdict for one in judged] == ["holds", *2 * ["cannot be answered here"], "not run"]
    assert [one.remarks for one in judged[:2]] == ["added after the results; r", "it would need more"]
    assert judged[0].p == judge([asked], studies)[0].p
    assert judged[1].p is None
    assert judged[1].difference is not None


def test_ranks_that_differ_from_student_are_remarked():
    gains = dict(zip("abcdefgh", (-0.3, -0.4, -0.2, -0.35, -0.25, -0.3, -0.45, 2.0), strict=True))
    (one,) = judge([claim("open", study="s", setting="x=1", against="y=1")], {"s": study_of(gains)})
    assert (one.verdict, one.remarks) == ("not decided", "")
    gains |= dict(zip("ijklmn", 6 * (-0.3,), strict=True))
    (one,) = judge([claim("open", study="s", setting="x=1", against="y=1")], {"s": study_of(gains)})
    assert one.verdict == "not decided"
    assert one.remarks.startswith("ranks differ: p 0.0")
    row = evidence_row(one, {"a", "b", "c", "h"})
    assert (row["median"].split()[0], row["better, worse"]) == ("-0.30", "1, 13 of 14")
    assert row["paintings"].startswith("+0.28 [")
    assert row["photographs"].startswith("-0.32 [-0.35, ")
    assert "paintings" not in evidence_row(one, {"a", "b"})
    (seeds,) = judge([claim("open", study="s", setting="x=1", against="y=1")], {"s": study_of(gains, "seed")})
    assert "photographs" not in evidence_row(seeds, {"a", "b", "c", "h"})


def options_of(study):
    """What a study lists, in the words of its jobs, which are Hydra's: ``critic=True``."""
    sweeper = yaml_of(read_text(SHIPPED / "experiment" / f"{study}.yaml", ""))["hydra"]["sweeper"]
    parser = OverridesParser.create()
    words = (parser.parse_overrides(shlex.split(setting)) for setting in sweeper["settings"])
    return {" ".join(job) for some in words for job in BasicSweeper.split_arguments(some, None)[0]}


@pytest.mark.parametrize("study", [name for name, listed in read_claims().items() if listed[0].setting])
def test_a_study_has_the_settings_of_its_claims(study):
    listed = (SHIPPED / "experiment" / f"{study}.yaml").is_file()
    options = options_of(study) if listed else set(studies_in([RECORDS], RECORDS)[study].table.index.levels[0])
    for one in read_claims()[study]:
        assert {one.setting, one.against} <= options, one.says


def test_the_shipped_paintings_are_those_of_the_set_that_is_held_out():
    lines = yaml_of(read_text(SHIPPED / "pictures" / "held_out_paintings.yaml", ""), list)
    assert {Path(name).name for line in lines for name in line} < set(yaml_of(read_text(SHIPPED_PAINTINGS, ""), list))


def test_a_record_of_another_program_has_its_command_and_question(tmp_path):
    table = pd.DataFrame({"cpu_seconds": [1.0, 2.0]}, pd.MultiIndex.from_tuples([("a=1", "0"), ("a=2", "0")]))
    table = table.rename_axis(["option", "seed"])
    Study("b", ("python", "b.py"), table, 2, 2, 2, "cheap", "Why?").record(tmp_path / "b.csv")
    one = studies_in([tmp_path], tmp_path)["b"]
    assert (one.command, one.question) == ("python b.py", "Why?")


def test_the_page_has_verdicts_plots_and_costs_of_what_was_run(tmp_path, run_task):
    typed = [*TYPED, "hydra/launcher=a", "hydra.searchpath=[file:///x/conf]"]
    make_sweep(tmp_path / "studies" / "a", typed, 0, psnr=(A, GAINED, C), cpu_seconds=900.0)
    (tmp_path / "claims.yaml").write_text(CLAIMS)
    words = (f"claims={tmp_path}/claims.yaml", f"page={tmp_path}/docs/ablations.md")
    result = run_task(verdicts, "task=verdicts", f"runs={tmp_path}/studies", *words)
    text = (tmp_path / "docs" / "ablations.md").read_text()
    assert (result["holds"], result.get("does_not_hold"), result["not_run"]) == (2, None, 1)
    assert "| claim | verdict | measured | metric | p of all | study | thesis | remarks |" in text
    assert "| o1 is better | holds | better: +0.50 [" in text
    assert "| o1 is better | order=o1 against order=o0 | PSNR, dB | +0.50 [" in text
    assert f"`brushexp {shlex.join(SHORT)}`" in text
    assert "4 pictures (a, b, c, d), 12 runs; 3.00 CPU hours." in text
    assert "![Differences of mine](ablations/mine.png)" in text
    assert (tmp_path / "docs" / "ablations" / "mine.png").is_file()
    assert "Verdicts on 4 claims: holds 2, not run 1, cannot be answered here 1." in text
    assert "| what nobody measures | 8 | it would need people |" in text
    assert "| something else | 9 | brushexp experiment=other |" in text
    assert "## other" not in text
    assert "A claim of *no worse* holds if the interval allows no loss that matters" in text
    message = "there is no sweep of an experiment=; run one first"
    refuses(message, run_task, verdicts, "task=verdicts", f"runs={tmp_path}/docs")


@pytest.mark.parametrize(("noted", "cost"), [
    ({"cpu_seconds": 900.0, "seconds_total": 300.0}, "3.00 CPU hours"),
    ({"seconds_total": 300.0}, "1.00 hours, CPU time not noted"),
    ({"seconds_total": None, "seconds": 600.0}, "2.00 hours, CPU time not noted"),
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
    _, fluid = study_rows(Study("mine", (), table, 6, 6, 6, ""), paired_differences(table))
    assert (fluid["setting"], fluid["better on"]) == ("engine=fluid", "3 of 3")


def test_an_incomplete_claim_is_explained(tmp_path):
    for wrong, message in (
        ("s: [{says: x, section: 1}]", "entry 1 of s has no setting and no against and no metric and no expects; give"),
        ("s: [{says: x, section: 1, cannot: y, metric: psnr}]", "has no setting and no against and no expects; give"),
        (CLAIMS.replace("psnr", "nope"), "unknown metric"),
        (CLAIMS.replace("psnr", "[psnr]"), "entry 1 of mine: metric: "),
        (CLAIMS.replace("order=o1", "order=o)"), r"claims=.*: 'order=o\)' is no setting as studies list them"),
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
    refuses("is no record of a study", studies_in, [tmp_path], tmp_path)
    (tmp_path / "a.csv").write_text("option,picture\n")  # any other table is left alone
    refuses("there is no sweep", studies_in, [tmp_path], tmp_path)


GAINS = [0.3, -0.1, 0.4, 0.25, 0.6, 0.15, -0.02, 0.33]


def test_p_and_intervals_are_those_of_scipy_certain_without_spread_and_multiplied_by_those_that_are_left():
    assert p_of_mean(GAINS, (0, math.inf)) == pytest.approx(ttest_1samp(GAINS, 0).pvalue)
    assert p_of_ranks(GAINS, (0, math.inf)) == pytest.approx(wilcoxon(GAINS).pvalue)
    assert p_of_mean(GAINS, (-math.inf, 0)) == p_of_ranks(GAINS, (-math.inf, 0)) == 1
    for p_of in (p_of_mean, p_of_ranks):
        assert p_of([0.0] * 6, (0, math.inf)) == 1
    assert p_of_mean([0.0] * 6, (-0.1, 0.1)) == p_of_mean([0.3] * 6, (0, math.inf)) == 0
    assert p_of_mean([0.3], (0, math.inf)) == 1
    assert holm([0.04, 0.001, 0.03]) == pytest.approx([0.06, 0.003, 0.06])
    assert holm([0.5, 0.9]) == [1, 1]
    assert holm([]) == []
    gains = np.random.default_rng(1).normal(size=201).tolist()
    middle, low, high = median_of(gains, 0.95)
    expected = bootstrap((gains,), np.median, method="percentile", n_resamples=9999).confidence_interval
    assert middle == np.median(gains)
    assert (low, high) == pytest.approx((expected.low, expected.high), abs=0.05)
    assert median_of(gains, 0.95) == (middle, low, high)


@pytest.mark.parametrize("margin", [0.1, 0.4])
def test_p_of_equivalence_is_below_a_level_where_the_interval_is_within_the_margin(margin):
    p = p_of_mean(GAINS, (-margin, margin))
    low, high = ttest_1samp(GAINS, 0).confidence_interval(1 - p) if p < 1 else (-math.inf, math.inf)
    assert max(-low, high) == pytest.approx(margin) or (p == 1 and np.mean(GAINS) > margin)


def test_settings_have_the_words_and_the_order_of_the_study():
    settings = ["init=even steps=800", "init=even init.orient=random steps=800", "init=even steps=50"]
    jobs = [["seed=0", f"image={name}", *setting.split()] for setting in settings for name in "ab"]
    labels = ["steps=800", "steps=800 init.orient=random", "steps=50"]
    index = pd.MultiIndex.from_product([labels, [*"ab"]], names=["option", "picture"])
    table = as_listed(pd.DataFrame({"psnr": range(6)}, index), jobs)
    assert [*table.index] == [(setting, name) for setting in settings for name in "ab"]
    assert table.index.names == index.names
    assert [*as_listed(table, []).index] == [*table.index]


PUBLISHED = """
sets:
  pair: {pictures: the pair, size: [30, 20], names: [a, b]}
  larger: {pictures: the pair enlarged, size: [60, 40], names: [a, b]}
  all: {pictures: all of them, size: [30, 20], names: [a, b, c]}
figures:
  - {set: pair, painter: Theirs, source: "Somebody, 2020, table 1", primitives: 9, what: blobs, psnr: 99}
  - {set: larger, painter: Theirs, source: "Somebody, 2020, table 2", psnr: 98}
  - {set: all, painter: Theirs, source: "Somebody, 2020, table 3", psnr: 97}
"""


def sections_in(folder, published=None):
    return sections_of(entries_of(gather([folder], folder)), read_published(published) if published else ())


def paint_run(folder, image, psnr, strokes, painter=None, **noted):
    """A made-up run; pictures of one name have one target."""
    chosen = {"image": f"{image}.png", "strokes": str(strokes), "frames": str(ord(image))}
    numbers = {"psnr": psnr, "l1": 0.1, "seconds": 2.0, "cpu_seconds": 3.0, "n_strokes": strokes}
    numbers |= {"anytime": [[1, psnr - 4], [2, psnr]]} | ({"painter": painter} if painter else {})
    return make_run(folder, chosen | noted.pop("chosen", {}), target=ord(image), color=7, **(numbers | noted))


@pytest.fixture
def runs(tmp_path):
    """Two painters of pictures a and b with 50 strokes, one of them with two seeds, and a alone with 90."""
    folder = tmp_path / "runs"
    folder.mkdir()
    write_text(tmp_path / "published.yaml", PUBLISHED)
    for image, psnr in (("a", 20.0), ("b", 30.0)):
        paint_run(folder, image, psnr, 50, chosen={"seed": "0"})
        paint_run(folder, image, psnr + 2, 50, chosen={"seed": "1"})
        paint_run(folder, image, psnr - 5 + (image == "a"), 50, "greedy", anytime=[[0.5, psnr - 9], [1, psnr - 4]])
    paint_run(folder, "a", 25.0, 90)
    paint_run(folder, "a", 24.0, 90, "greedy", chosen={"painter": "greedy_fast"})  # a preset
    make_run(folder, {"task": "train"}, psnr=1.0)
    spoilt = {"psnr": "much", "l1": 0.1, "seconds": 2.0}
    make_run(folder, {"image": "a.png", "strokes": "90", "painter": "zou"}, target=ord("a"), color=7, **spoilt)
    paint_run(folder, "a", 1.0, 50, status="failed")
    return folder


def test_means_are_of_the_same_pictures_and_differences_are_paired(runs, tmp_path):
    both, alone = sections_in(runs, tmp_path / "published.yaml")
    assert [len(section.pictures) for section in (both, alone)] == [2, 1]
    ours, greedy = both.rows
    assert (ours.painter, greedy.painter) == ("gradient", "greedy")
    assert ours.numbers["psnr"].tolist() == [21, 31]  # over seeds first
    assert both.against_best(ours) is None
    mean, low, high = both.against_best(greedy)
    assert (mean, low, high) == pytest.approx((-5.5, *stats.t.interval(0.95, 1, loc=-5.5, scale=0.5)))
    names = [(row.painter, row.strokes) for row in alone.rows]
    assert names == [("gradient", 50), ("greedy", 50), ("gradient", 90), ("greedy_fast", 90)]
    assert [one.source[-1] for one in both.published] == ["1", "3"]  # not those of another size
    assert ours.psnr_at(0.5) == []
    assert (ours.psnr_at(2), greedy.psnr_at(2)) == ([21, 31], [16, 26])  # what is done stays


def test_unknown_numbers_of_strokes_are_not_equal_ones(tmp_path):
    for painter, psnr in (("greedy", 20.0), ("zou", 25.0)):
        make_run(tmp_path, {"image": "a.png"}, target=9, color=7, psnr=psnr, l1=0.1, seconds=2.0, painter=painter)
    (section,) = sections_in(tmp_path)
    assert [(row.strokes, section.against_best(row)) for row in section.rows] == [(None, None), (None, None)]


def test_settings_that_all_have_are_left_out_and_those_with_spaces_stay_whole(tmp_path):
    for image, style, color in (("a", "my photo.jpg", "rgb"), ("a", "my photo.jpg", "oklab"), ("a", "her.jpg", "rgb")):
        paint_run(tmp_path, image, 20.0, 50, chosen={"style.image": style, "color": color})
    for color in ("rgb", "oklab"):
        paint_run(tmp_path, "b", 20.0, 50, chosen={"style.image": "my photo.jpg", "color": color})
    both, alone = sections_in(tmp_path)
    assert sorted(row.settings for row in both.rows) == ["color=oklab", "color=rgb"]
    settings = ("her.jpg color=rgb", "my photo.jpg color=oklab", "my photo.jpg color=rgb")
    assert {row.settings for row in alone.rows} == {f"style.image={one}" for one in settings}


@pytest.mark.parametrize("name", ["painter", "settings", "strokes"])
def test_a_picture_may_have_the_name_of_a_column(tmp_path, name):
    for target, image in enumerate((name, "other")):
        make_run(tmp_path, {"image": f"{image}.png"}, target=target, color=7, psnr=20.0 + target, l1=0.1, seconds=2.0)
    (row,) = by_picture(sections_in(tmp_path)[0])
    assert list(row.items())[3:] == [("other", "21.00"), (f"{name} (2)", "20.00")]


def test_published_figures_stand_beside_and_say_what_they_are_of(runs, tmp_path):
    both, *_ = sections_in(runs, tmp_path / "published.yaml")
    cells = table_cells(both)
    assert [row["pictures"] for row in cells] == [
        "these", "these", "the same pictures at 30 x 20", "all of them, of which 2 are here at 30 x 20",
    ]  # fmt: skip
    assert cells[0]["PSNR, dB"] == f"26.00 ± {stats.t.interval(0.95, 1, scale=5)[1]:.2f}"
    assert cells[2] | {"PSNR, dB": "99", "strokes": "9 blobs", "optimisation, s": "–"} == cells[2]
    assert [row["a"] for row in by_picture(both)] == ["21.00", "16.00"]
    assert [row["1 s"].split(" ± ")[0] for row in at_equal_seconds(both)] == ["22.00", "21.00"]


def test_the_page_fits_sorts_and_asks_nothing(runs, tmp_path, opened):
    sections = sections_in(runs, tmp_path / "published.yaml")
    with Image.open(write_standings_plot(runs, sections)) as picture:
        assert np.asarray(picture.convert("RGB")).std() > 1
    watched = opened(write_leaderboard_page(runs, sections, sections[0].published, "On <one> machine."), NARROW)
    assert not watched.is_too_wide()
    column = watched.page.locator("#section-1 table").first.locator("th", has_text="PSNR")
    column.get_by_role("button").click()
    names = "[...document.querySelector('#section-1 tbody').rows].map(row => row.cells[0].textContent)"
    assert watched.evaluate(names) == ["Theirs", "Theirs", "gradient", "greedy"]
    style = "getComputedStyle(document.querySelector('.published').cells[0]).fontStyle"
    assert watched.evaluate(style) == "italic"
    assert watched.page.get_by_text("On <one> machine.").is_visible()
    assert not watched.errors
    assert not watched.foreign


def test_what_ships_has_sources_and_is_refused_when_it_is_wrong(tmp_path):
    published = read_published()
    assert len({one.painter for one in published}) >= 8
    assert all(re.search(r"\d{4}|docs/|issue", one.source) and one.figures for one in published)
    for old, new, reason in (
        ("source:", "sauce:", "entry 1 of figures: sauce: Key 'sauce' not in .*; its keys are set, painter, source"),
        ("psnr: 99", "psnr: high", "entry 1 of figures: psnr: Value 'high'"),
        ("psnr: 99", "psnr: .nan", "entry 1 of figures has no figure, or one that is no number"),
        ("names: [", "names: [[1], ", r"sets has names with \[1\]"),
        (", psnr: 98", "", "entry 2 of figures has no figure"),
        ("set: pair", "set: par", "entry 1 of figures: set is par; choose one of pair, larger, all"),
        ("sets:", "lists:", "the file has lists, figures; its keys are sets"),
        ("painter: Theirs", "painter: '${oc.env:HOME}'", "refers to something else; write the value itself"),
    ):
        write_text(tmp_path / "wrong.yaml", PUBLISHED.replace(old, new, 1))
        refuses(reason, read_published, tmp_path / "wrong.yaml")


def test_paintings_by_others_are_measured_as_ours(run_task, tmp_path, caplog):
    ours = run_task(paint, "image=coffee", "resolution=32", "strokes=12", "steps=2", "frames=0", "report=false")
    assert ours["cpu_seconds"] > 0
    run, theirs, photos, twins, broken = (tmp_path / name for name in ("run", "theirs", "photos", "twins", "broken"))
    for folder in (run, theirs, photos, twins, broken):
        folder.mkdir()
    for name in ("painting.png", "target.png", "metrics.json", "catalogue.h5"):
        (tmp_path / name).rename(run / name)
    (run / "painting.png").rename(theirs / "x.png")
    write_picture(run / "painting.png", np.zeros((21, 32, 3), np.uint8))
    (photos / "x.png").write_bytes((run / "target.png").read_bytes())
    (broken / "metrics.json").write_text("text")
    words = (f"runs=[{run},{broken}]", "name=Theirs", f"published={tmp_path}/published.yaml")
    write_text(tmp_path / "published.yaml", PUBLISHED)
    result = run_task(task, "task=leaderboard", *words, f"add={theirs}", f"target={photos}", "seconds=3")
    assert result["paintings"] == 2
    assert f"no finished paintings: {broken}" in caplog.text
    rows = read_csv(tmp_path / "leaderboard.csv")
    assert {row["painter"] for row in rows} == {"Theirs", "gradient"}
    assert [float(row["psnr"]) for row in rows] == pytest.approx([ours["psnr"]] * 2)
    assert not (tmp_path / "anytime.png").exists()  # there is one curve
    page = (tmp_path / "report.html").read_text()
    assert page.count("Theirs") > 2
    assert '<tr class="published">' in page
    assert "*Somebody, 2020, table 1*" in (tmp_path / "leaderboard.md").read_text()
    assert r"\toprule" in (tmp_path / "leaderboard.tex").read_text()
    run_task(task, "task=leaderboard", "name=Again", f"add={run}/catalogue.h5", f"target={photos}/x.png")
    again = gather([tmp_path / "added" / "catalogue"], tmp_path)
    assert again["metric", "psnr"].tolist() == [pytest.approx(ours["psnr"])]
    assert again["metric", "n_strokes"].tolist() == [12]
    for name in ("x.jpg", "x.png"):
        (twins / name).write_bytes((run / "target.png").read_bytes())
    for wrong, reason in (
        ((), "nothing is given; try runs=outputs, or add=painting.png target=photo.jpg name=theirs"),
        ((f"add={theirs}",), "needs what was painted; give target=photo.jpg"),
        ((f"add={theirs}/x.png", "target=coffee"), "metrics compare pictures of one size"),
        ((f"add={theirs}", f"target={run}"), "has no picture x for add="),
        ((f"add={twins}", f"target={photos}"), "x.png and x.jpg are both of x; take one of them away"),
    ):
        refuses(re.escape(reason), run_task, task, "task=leaderboard", *wrong)


def test_the_task_begins_from_the_command_line(tmp_path):
    (tmp_path / "none").mkdir()
    code, output = ended(tmp_path, "task=leaderboard", "runs=none")
    assert (code, output) == (
        1,
        "brushexp: runs=none: there is no finished run in it; give the folder of a run or of a sweep\n",
    )


ROWS = yaml_of(read_text(THESIS, ""), list)
OF_THE_THESIS = {row["key"]: row["value"] for row in ROWS if row["value"] != []}


def listed(cfg) -> dict[str, str]:
    """Key -> what the run has instead."""
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
    words = "there is no finished painting; give folders of such with runs="
    refuses(words, run_task, departures_task, "task=departures", f"runs=[{tmp_path}]")


def test_errors_count_in_the_half_in_which_they_are():
    target = torch.full((3, 32, 48), 0.5)
    target[:, :, 24:] += 0.4 * (torch.rand(3, 32, 24) - 0.5)
    painting = target.clone()
    painting[:, :, :16] += 0.1
    flat, busy = FlatHalf()(Comparison(painting, target)), BusyHalf()(Comparison(painting, target))
    assert flat == pytest.approx(-10 * math.log10(0.01 * 16 / 24), abs=1e-4)
    assert busy == math.inf or busy > 80
