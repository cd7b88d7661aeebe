"""The report of a sweep: results, table and sheet, whatever the runs did."""

import csv
import json
import logging
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hydra.core.utils import JobReturn, JobStatus
from hydra.types import RunMode
from omegaconf import OmegaConf
from PIL import Image

from brushexp.errors import UserError
from brushexp.results.drawing import ALARM, LIMIT, SIDE, Cell, Grid, Type, draw, plain_letters
from brushexp.results.runs import overrides
from brushexp.results.sheet import write_sheet
from brushexp.results.sweep import LOCK, SweepReport, first_line, renew
from brushexp.results.table import as_csv, as_markdown, collect, settings, varying, write_table
from brushexp.system.files import write_json, write_picture

METRICS = {
    "psnr": 27.123456,
    "ssim": 0.87654321,
    "l1": 0.0312345,
    "perceptual": None,
    "seconds": 12.3456,
    "seconds_total": 15.0,
    "seconds_per_step": 0.02,
    "peak_memory_mb": 512.0,
    "n_strokes": 2600,
    "steps": 500,
    "device": "cpu",
    "status": "completed",
}
ERROR = "RuntimeError: stroke 17 | is *singular*"


def make_run(folder: Path, number: int, chosen: dict[str, str], *, failed: bool = False, **metrics: object) -> Path:
    run = folder / str(number)
    run.mkdir(parents=True)
    result = {"run": run.name, "status": "failed" if failed else "completed"}
    result |= {"error": ERROR} if failed else {}
    result |= {"overrides": chosen, "loss": chosen.get("loss", "mse")}
    write_json(run / "result.json", result | ({} if failed else METRICS | metrics))
    return run


def paint(run: Path, color: int, target: int = 200, size: tuple[int, int] = (24, 32)) -> None:
    write_picture(run / "target.png", np.full((*size, 3), target, np.uint8))
    write_picture(run / "painting.png", np.full((*size, 3), color, np.uint8))


def make_sweep(folder: Path, axes: dict[str, list[str]], failed: tuple[int, ...] = ()) -> list[dict[str, str]]:
    combinations = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    for number, chosen in enumerate(combinations):
        run = make_run(folder, number, chosen, failed=number in failed)
        if number not in failed:
            paint(run, 20 + number)
    return combinations


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def greys(path: Path) -> list[list[int]]:
    """The grey levels of the pictures on a sheet, row by row."""
    with Image.open(path) as sheet:
        pixels = np.asarray(sheet)
    shades = {20 + k for k in range(60)} | {100, 200, 201}
    found: list[list[int]] = []
    for line in pixels[:, :, 0]:
        lengths = np.diff(np.flatnonzero(np.diff(line.astype(int), prepend=-1, append=-1)))
        starts = np.flatnonzero(np.diff(line.astype(int), prepend=-1))
        row = [int(line[s]) for s, n in zip(starts, lengths, strict=True) if n > 100 and int(line[s]) in shades]
        if row and (not found or found[-1] != row):
            found.append(row)
    return found


# results and table


def test_results_come_in_the_order_of_the_job_numbers(tmp_path):
    for number in (10, 2, 0, 1):
        make_run(tmp_path, number, {})
    make_run(tmp_path / "unrelated", 0, {})
    assert [result["run"] for result in collect(tmp_path)] == ["0", "1", "2", "10"]


def test_a_folder_without_results_is_explained(tmp_path):
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(UserError, match=r"no result\.json below .*; give the folder of a sweep"):
            collect(folder)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "\x00"])
def test_an_unreadable_result_counts_as_failed(tmp_path, text):
    make_run(tmp_path, 0, {})
    make_run(tmp_path, 1, {})
    (tmp_path / "1" / "result.json").write_text(text)
    write_table(tmp_path)
    row = read_csv(tmp_path / "table.csv")[1]
    assert row["status"] == "failed"
    assert "result.json cannot be read" in row["error"]


def test_the_csv_has_every_column_in_full_precision(tmp_path):
    make_run(tmp_path, 0, {"init": "grid", "image": "a,b.png"})
    make_run(tmp_path, 1, {"init": "slic"}, failed=True)
    path, _ = write_table(tmp_path)
    first, second = read_csv(path)
    assert list(first)[:3] == ["run", "status", "error"]
    assert set(METRICS) | {"init", "image", "loss"} <= set(first)
    assert float(first["psnr"]) == METRICS["psnr"]
    assert first["image"] == "a,b.png"
    assert first["perceptual"] == ""
    assert (second["status"], second["error"], second["psnr"], second["init"]) == ("failed", ERROR, "", "slic")


def test_a_setting_with_the_name_of_a_metric_gets_a_column_of_its_own(tmp_path):
    make_run(tmp_path, 0, {"steps": "1000", "device": "auto", "status": "x"}, steps=420)
    row = read_csv(write_table(tmp_path)[0])[0]
    assert (row["steps"], row["override.steps"]) == ("420", "1000")
    assert (row["device"], row["override.device"]) == ("cpu", "auto")
    assert (row["status"], row["override.status"]) == ("completed", "x")


def test_a_curve_is_no_column(tmp_path):
    make_run(tmp_path, 0, {"seed": "1"}, anytime=[[0.1, 20.0], [0.2, 25.0]], options={"a": 1})
    csv_path, md_path = write_table(tmp_path)
    assert not {"anytime", "options"} & set(read_csv(csv_path)[0])
    assert "anytime" not in md_path.read_text()


def test_the_names_of_the_losses_stand_for_the_override(tmp_path):
    make_run(tmp_path, 0, {"loss": "[mse,kl]"})
    path = tmp_path / "0" / "result.json"
    write_json(path, json.loads(path.read_text()) | {"loss": "mse+kl"})
    assert settings(collect(tmp_path)[0])["loss"] == "mse+kl"
    assert read_csv(write_table(tmp_path)[0])[0]["loss"] == "mse+kl"


def test_only_what_varies_is_in_the_markdown(tmp_path):
    make_sweep(tmp_path, {"image": ["cat.png"], "init": ["grid", "slic"], "seed": ["1", "2"]}, failed=(3,))
    text = write_table(tmp_path)[1].read_text().splitlines()
    text = text[text.index("4 runs, 1 failed.") :]  # above it are the means over seeds
    assert text[2] == "| run | init | seed | status | psnr | ssim | l1 | perceptual | seconds | n\\_strokes |"
    assert text[4] == "| 0 | grid | 1 | completed | 27.12 | 0.8765 | 0.0312 | – | 12.3 | 2600 |"
    assert text[7].startswith("| 3 | slic | 2 | failed: RuntimeError: stroke 17 \\| is \\*singular\\* | – |")
    assert len(text) == 8


@pytest.mark.parametrize(
    ("value", "shown"),
    [("a|b", r"a\|b"), ("*_x_*", r"\*\_x\_\*"), ("[mse](x)", r"\[mse\](x)"), ("<b>", r"\<b\>"), ("a\nb`", r"a b\`")],
)
def test_markdown_shows_values_as_they_are(tmp_path, value, shown):
    make_run(tmp_path, 0, {"image": value})
    make_run(tmp_path, 1, {"image": "other"})
    row = as_markdown(collect(tmp_path)).splitlines()[4]
    assert row.startswith(f"| 0 | {shown} | completed |")


def test_long_errors_are_cut_and_infinite_psnr_is_shown(tmp_path):
    make_run(tmp_path, 0, {}, psnr=None, l1=0.0)
    make_run(tmp_path, 1, {}, psnr=None)
    run = make_run(tmp_path, 2, {}, failed=True)
    write_json(run / "result.json", json.loads((run / "result.json").read_text()) | {"error": "x" * 5000})
    lines = as_markdown(collect(tmp_path)).splitlines()
    assert "| completed | inf |" in lines[4]
    assert "| completed | – |" in lines[5]
    assert len(lines[6]) < 300
    assert "x" * 5000 in as_csv(collect(tmp_path))


def test_what_varies_includes_settings_that_only_some_runs_have(tmp_path):
    make_run(tmp_path, 0, {"seed": "1", "init": "grid"})
    make_run(tmp_path, 1, {"seed": "1"})
    assert varying(collect(tmp_path)) == {"init": ["grid", ""]}


# sheet


def test_the_target_comes_first_and_every_run_follows(tmp_path):
    make_sweep(tmp_path, {"seed": ["1", "2", "3"]})
    assert greys(write_sheet(tmp_path)) == [[200, 20, 21, 22]]


def test_rows_are_about_equally_full(tmp_path):
    make_sweep(tmp_path, {"seed": [str(k) for k in range(6)]})
    assert greys(write_sheet(tmp_path)) == [[200, 20, 21, 22], [23, 24, 25]]


def test_two_settings_that_cover_all_combinations_form_a_matrix(tmp_path):
    make_sweep(tmp_path, {"loss": ["mse", "kl"], "init": ["grid", "slic", "fill"]})
    assert greys(write_sheet(tmp_path)) == [[200, 20, 21, 22], [200, 23, 24, 25]]


def test_an_incomplete_matrix_is_laid_out_row_by_row(tmp_path):
    make_sweep(tmp_path, {"loss": ["mse", "kl"], "init": ["grid", "slic", "fill"]})
    for path in (tmp_path / "5").iterdir():
        path.unlink()
    assert greys(write_sheet(tmp_path)) == [[200, 20, 21, 22, 23, 24]]


def test_every_target_stands_where_its_runs_are(tmp_path):
    for number, (image, init) in enumerate(product(["/d/a.png", "/d/b.png"], ["grid", "slic"])):
        run = make_run(tmp_path, number, {"image": image, "init": init})
        paint(run, 20 + number, target=200 if image == "/d/a.png" else 100)
    assert greys(write_sheet(tmp_path)) == [[200, 20, 21], [100, 22, 23]]
    for number in range(4):
        result = tmp_path / str(number) / "result.json"
        data = json.loads(result.read_text())
        write_json(result, data | {"overrides": data["overrides"] | {"seed": str(number)}})
    assert greys(write_sheet(tmp_path)) == [[200, 20, 21, 100, 22, 23]]


def test_failed_runs_appear_as_a_grey_box_with_words(tmp_path):
    make_sweep(tmp_path, {"seed": ["1", "2", "3"]}, failed=(1,))
    path = write_sheet(tmp_path)
    assert greys(path) == [[200, 20, 22]]
    with Image.open(path) as sheet:
        pixels = np.asarray(sheet)
    assert (pixels == [0xED, 0xED, 0xED]).all(-1).sum() > 30_000
    alarm = [int(ALARM[i : i + 2], 16) for i in (1, 3, 5)]
    assert (pixels == alarm).all(-1).any()


def test_without_a_painting_there_is_no_sheet(tmp_path):
    make_run(tmp_path, 0, {})
    make_run(tmp_path, 1, {}, failed=True)
    assert write_sheet(tmp_path) is None
    assert not (tmp_path / "sheet.png").exists()


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_a_damaged_picture_does_not_stop_the_sheet(tmp_path, share):
    make_sweep(tmp_path, {"seed": ["1", "2"]})
    path = tmp_path / "1" / "painting.png"
    write_picture(path, np.random.default_rng(0).integers(0, 256, (50, 60, 3), np.uint8))
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    assert greys(write_sheet(tmp_path))[0][:2] == [200, 20]


def test_pictures_of_all_shapes_fit(tmp_path):
    for number, size in enumerate([(1, 1), (900, 30), (30, 900), (1, 2000), (500, 400)]):
        paint(make_run(tmp_path, number, {"seed": str(number)}), 20 + number, size=size)
    with Image.open(write_sheet(tmp_path)) as sheet:
        assert max(sheet.size) < 6 * (SIDE + 40)


@pytest.mark.parametrize(("count", "long"), [(200, True), (201, False), (13, True)])
def test_large_sheets_stay_within_bounds(tmp_path, count, long):
    write_picture(tmp_path / "a.png", np.zeros((400, 400, 3), np.uint8))
    label = ("some.very.long_name=of/a/value/that/does/not/fit",) * (8 if long else 1)
    columns = 15 if count > 100 else 1
    cells = [Cell(tmp_path / "a.png", label, ("27.1 dB", "300.0 s")) for _ in range(count)]
    sheet = draw(Grid([cells[i : i + columns] for i in range(0, count, columns)]), "title")
    assert max(sheet.size) <= LIMIT


def test_labels_are_broken_between_words_first_and_never_overflow():
    type_ = Type.beside(400)
    assert type_.wrapped(["loss=mse", "init=grid"], 400, 4) == ["loss=mse   init=grid"]
    assert type_.wrapped(["loss=mse", "init=grid"], 120, 4) == ["loss=mse", "init=grid"]
    lines = type_.wrapped(["image=a_very/long_path/with-many_parts/and_a_name_without_end" * 3], 200, 3)
    assert len(lines) == 3
    assert lines[-1].endswith("...")
    assert all(type_.font.getlength(line) <= 200 for line in lines)


def test_letters_that_the_font_lacks_are_replaced():
    assert plain_letters("größe.png é 画") == "gro?e.png e ?"


# callback

CONFIG = {"loss": {"mse": {}, "kl": {}}, "hydra": {"mode": "MULTIRUN", "overrides": {"task": ["loss=[mse,kl]", "~b"]}}}


def end_job(folder: Path, number: int, outcome: object, mode: str = "MULTIRUN") -> Path:
    """What Hydra does at the end of a job: the outcome is a dict of numbers, or an exception."""
    run = folder / str(number)
    run.mkdir(parents=True, exist_ok=True)
    config = OmegaConf.merge(CONFIG, {"hydra": {"runtime": {"output_dir": str(run)}, "sweep": {"dir": str(folder)}}})
    config.hydra.mode = RunMode[mode]
    status = JobStatus.FAILED if isinstance(outcome, Exception) else JobStatus.COMPLETED
    SweepReport().on_job_end(config, JobReturn(status=status, _return_value=outcome))
    return run


def test_every_job_leaves_its_result_and_renews_the_table(tmp_path):
    run = end_job(tmp_path, 0, METRICS)
    result = json.loads((run / "result.json").read_text())
    assert result["overrides"] == {"loss": "[mse,kl]", "b": "(removed)"}
    assert (result["run"], result["status"], result["loss"]) == ("0", "completed", "mse+kl")
    assert {key: result[key] for key in METRICS} == METRICS
    assert len(read_csv(tmp_path / "table.csv")) == 1
    end_job(tmp_path, 1, RuntimeError("first line\nsecond line"))
    rows = read_csv(tmp_path / "table.csv")
    assert [row["status"] for row in rows] == ["completed", "failed"]
    assert rows[1]["error"] == "RuntimeError: first line"


def test_an_interrupted_job_is_called_so(tmp_path):
    end_job(tmp_path, 0, METRICS | {"status": "interrupted"})
    assert read_csv(tmp_path / "table.csv")[0]["status"] == "interrupted"


def test_a_task_without_numbers_is_reported_too(tmp_path):
    end_job(tmp_path, 0, None)
    assert read_csv(tmp_path / "table.csv")[0]["status"] == "completed"


def test_a_single_run_has_no_result_file(tmp_path):
    end_job(tmp_path, 0, METRICS, mode="RUN")
    assert [path.name for path in tmp_path.rglob("*")] == ["0"]


def test_trouble_with_the_report_is_logged_with_its_reason(tmp_path, caplog):
    (tmp_path / "table.csv").mkdir()
    end_job(tmp_path, 0, METRICS)
    record = caplog.records[-1]
    assert record.levelno == logging.ERROR
    assert "table.csv: Is a directory" in record.getMessage()


@pytest.mark.parametrize("mode", ["RUN", "MULTIRUN"])
def test_an_error_reaches_the_log_of_its_run(tmp_path, mode, caplog):
    handler = logging.FileHandler(tmp_path / "run.log")
    logging.getLogger().addHandler(handler)
    try:
        try:
            raise RuntimeError("a bug\nin two lines")
        except RuntimeError as error:
            end_job(tmp_path, 3, error, mode)
        end_job(tmp_path, 4, UserError("strokes is -1; choose strokes=1000"), mode)
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()
    text = (tmp_path / "run.log").read_text()
    assert "run 3 failed: RuntimeError: a bug\nTraceback" in text
    assert text.endswith("run 4 failed: strokes is -1; choose strokes=1000\n")
    assert bool(caplog.records) == (mode == "MULTIRUN")  # Hydra itself shows the error of a single run


def test_the_last_of_many_writers_sees_all_results(tmp_path):
    def work(number: int) -> None:
        paint(make_run(tmp_path, number, {"seed": str(number)}), 20 + number)
        renew(tmp_path)

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(work, range(12)))
    assert len(read_csv(tmp_path / "table.csv")) == 12
    assert sum(map(len, greys(tmp_path / "sheet.png"))) == 13
    files = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert files <= {"table.csv", "table.md", "sheet.png", "report.html", LOCK}


def test_the_lock_is_removed_when_the_sweep_is_over(tmp_path):
    (tmp_path / LOCK).touch()
    config = OmegaConf.create({"hydra": {"sweep": {"dir": str(tmp_path)}}})
    SweepReport().on_multirun_end(config)
    SweepReport().on_multirun_end(config)
    assert not (tmp_path / LOCK).exists()


def test_overrides_of_every_form_are_read():
    words = ["loss=mse", "+a.b=1", "++c=x=y", "~d", "e=", "+f=[1,2]"]
    expected = {"loss": "mse", "a.b": "1", "c": "x=y", "d": "(removed)", "e": "", "f": "[1,2]"}
    assert overrides(words) == expected


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (UserError("a; b"), "a; b"),
        (KeyError(), "KeyError"),
        (ValueError("\nx\ny"), "ValueError: x"),
        (MemoryError("no"), "MemoryError: no"),
    ],
)
def test_an_error_is_told_in_one_line(error, line):
    assert first_line(error) == line


APP = """
from pathlib import Path
import hydra, numpy as np
from hydra.core.hydra_config import HydraConfig
from brushexp.system.files import write_picture

@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(cfg):
    if cfg.seed == 2:
        raise RuntimeError("this job fails")
    for name in ("target.png", "painting.png"):
        write_picture(Path(HydraConfig.get().runtime.output_dir) / name, np.full((20, 30, 3), 20 + cfg.seed, np.uint8))
    return {"psnr": float("nan"), "steps": cfg.steps - 1, "status": "completed"}

main()
"""
APP_CONFIG = """
seed: 0
steps: 7
loss: {mse: {weight: 1.0}}
hydra:
  sweep: {dir: out, subdir: "${hydra.job.num}"}
  callbacks: {report: {_target_: brushexp.results.sweep.SweepReport}}
"""


@pytest.mark.parametrize("launcher", ["basic", pytest.param("joblib", marks=pytest.mark.slow)])
def test_a_real_sweep_with_a_failing_job_is_reported_whole(tmp_path, launcher):
    if launcher == "joblib":
        pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    (tmp_path / "conf").mkdir()
    (tmp_path / "conf" / "config.yaml").write_text(APP_CONFIG)
    (tmp_path / "app.py").write_text(APP)
    parallel = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"] * (launcher == "joblib")
    command = [sys.executable, "app.py", "-m", "seed=1,2,3", "steps=9", *parallel]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, env=os.environ | {"OMP_NUM_THREADS": "1"}
    )
    assert done.returncode == 1, done.stderr
    rows = read_csv(tmp_path / "out" / "table.csv")
    assert [(row["seed"], row["status"], row["error"]) for row in rows] == [
        ("1", "completed", ""),
        ("2", "failed", "RuntimeError: this job fails"),
        ("3", "completed", ""),
    ]
    assert [(row["override.steps"], row["steps"], row["psnr"]) for row in rows] == [
        ("9", "8", ""),
        ("9", "", ""),
        ("9", "8", ""),
    ]
    assert greys(tmp_path / "out" / "sheet.png") == [[21, 21, 23, 23]]
    assert "RuntimeError: this job fails\nTraceback" in (tmp_path / "out" / "1" / "app.log").read_text()


def test_runs_that_differ_in_the_seed_alone_have_a_mean_and_a_spread(tmp_path):
    for number, (init, seed, psnr) in enumerate([("grid", 0, 20.0), ("grid", 1, 22.0), ("slic", 0, 30.0)]):
        make_run(tmp_path, number, {"init": init, "seed": str(seed)}, psnr=psnr)
    make_run(tmp_path, 3, {"init": "slic", "seed": "1"}, failed=True)
    lines = as_markdown(collect(tmp_path)).splitlines()
    assert lines[0] == "Mean ± standard deviation over seeds."
    assert lines[2].startswith("| init | runs | psnr |")
    assert lines[4].startswith("| grid | 2 | 21.00 ± 1.41 |")
    assert lines[5].startswith("| slic | 1 | 30.00 |")
    assert lines[7] == "4 runs, 1 failed."
