"""Trackers: what arrives in each, that none of them can stop a run, and that none goes to the network unasked."""

import io
import json
import logging
import math
import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from hydra.types import RunMode
from PIL import Image

from brushexp.app.tracking import Trackers, run_of, settings_of, trackers_of
from brushexp.errors import UserError
from brushexp.plugins.logger import tensorboard
from brushexp.plugins.logger.base import Logger, Run
from brushexp.plugins.logger.wandb import Mode, WeightsAndBiases, mode_of
from brushexp.system.files import write_picture

ROOT = Path(__file__).parents[1]
FAILING = '''
"""Trackers that fail at each point."""
from lightning.pytorch.loggers import CSVLogger
from brushexp.plugins.logger.base import Logger
from brushexp.registry import register


def curves(run):
    return CSVLogger(run.folder, name="", version="others")


@register("logger", "bad_open")
class BadOpen(Logger):
    """Fails when it opens."""

    def __init__(self) -> None: ...

    def open(self, run):
        raise RuntimeError("no room")


@register("logger", "bad_curves")
class BadCurves(Logger):
    """Fails at the first point of a curve."""

    def __init__(self) -> None: ...

    def open(self, run):
        logger = curves(run)
        logger.log_metrics = lambda metrics, step: 1 / 0
        return logger


@register("logger", "bad_end")
class BadEnd(Logger):
    """Fails at the end."""

    def __init__(self) -> None: ...

    def open(self, run):
        return curves(run)

    def finish(self, run):
        raise OSError("disk full")
'''
WATCHING = """
import os, socket

def note(where):
    with open(os.environ["NOTES"], "a") as file:
        print(where, file=file)

def watched(call):
    def connect(self, address):
        if self.family != socket.AF_UNIX and not str(address[0]).startswith(("127.", "::1")):
            note(address)
        return call(self, address)
    return connect

def asked(call):
    def getaddrinfo(host, *rest, **more):
        if host not in (None, "localhost", "127.0.0.1", "::1"):
            note(host)
        return call(host, *rest, **more)
    return getaddrinfo

socket.socket.connect = watched(socket.socket.connect)
socket.socket.connect_ex = watched(socket.socket.connect_ex)
socket.getaddrinfo = asked(socket.getaddrinfo)
"""


class Proxy:
    """Where all traffic would go; it notes who comes."""

    def __init__(self) -> None:
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.visitors: list[bytes] = []
        threading.Thread(target=self._wait, daemon=True).start()

    @property
    def environment(self) -> dict[str, str]:
        url = f"http://127.0.0.1:{self.socket.getsockname()[1]}"
        names = ("http_proxy", "https_proxy", "all_proxy")
        return {key: url for name in names for key in (name, name.upper())} | {"no_proxy": "", "NO_PROXY": ""}

    def _wait(self) -> None:
        while True:
            try:
                visitor, _ = self.socket.accept()
            except OSError:
                return
            with visitor:
                self.visitors.append(visitor.recv(200))


@pytest.fixture(scope="module")
def tracked(tmp_path_factory) -> SimpleNamespace:
    """A small run, the only one of a sweep, with every tracker and three that fail."""
    folder = tmp_path_factory.mktemp("tracked")
    for name in ("plugins", "watching", "home"):
        (folder / name).mkdir()
    (folder / "plugins" / "failing.py").write_text(FAILING)
    (folder / "watching" / "sitecustomize.py").write_text(WATCHING)
    rows, columns = np.mgrid[:40, :56]
    write_picture(folder / "picture.png", np.stack([4 * columns, 6 * rows, 255 - 4 * columns], -1).astype(np.uint8))
    proxy = Proxy()
    environment = {key: value for key, value in os.environ.items() if not key.startswith("WANDB_")}
    environment |= proxy.environment | {
        "HOME": str(folder / "home"),
        "MPLCONFIGDIR": str(Path.home() / ".cache" / "matplotlib"),  # to look for fonts anew takes seconds
        "BRUSHEXP_PLUGINS": str(folder / "plugins"),
        "PYTHONPATH": str(folder / "watching"),
        "NOTES": str(folder / "notes.txt"),
    }
    command = [sys.executable, "-W", "ignore::FutureWarning", str(ROOT / "run.py"), "hydra.mode=MULTIRUN"]
    settings = ["steps=20", "frames=12", "threads=1", "report=false", f"output={folder}/my sweep"]
    loggers = "logger=[bad_open,csv,bad_curves,tensorboard,bad_end,wandb]"
    done = subprocess.run(
        [*command, f"image={folder}/picture.png", *settings, loggers, "logger.wandb.tags=[a,b]"],
        check=False, capture_output=True, text=True, cwd=folder, env=environment, timeout=250, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    proxy.socket.close()
    assert done.returncode == 0, done.stderr
    run = folder / "my sweep" / "0"
    metrics = json.loads((run / "metrics.json").read_text())
    return SimpleNamespace(folder=folder, run=run, metrics=metrics, done=done, proxy=proxy)


def picture(path: Path | io.BytesIO) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def records(path: Path) -> Iterator:
    """Read a .wandb file: a log of LevelDB, blocks of 32 KiB with pieces of messages."""
    from wandb.proto.wandb_internal_pb2 import Record  # noqa: PLC0415

    data, at, message = path.read_bytes(), 7, b""
    assert data[:4] == b":W&B"
    while at + 7 <= len(data):
        if 32768 - at % 32768 < 7:
            at += 32768 - at % 32768
            continue
        length, kind = struct.unpack("<HB", data[at + 4 : at + 7])
        message += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # whole, or the last piece
            yield Record.FromString(message)
            message = b""


def row_of(items) -> dict[str, Any]:
    """What was logged at once, nested as it was."""
    row: dict[str, Any] = {}
    for item in items:
        *above, key = item.nested_key or [item.key]
        inner = row
        for name in above:
            inner = inner.setdefault(name, {})
        inner[key] = json.loads(item.value_json)
    return row


def test_trackers_that_fail_are_named_once_and_the_run_goes_on(tracked):
    log = (tracked.run / "run.log").read_text()
    for line in (
        "logger=bad_open stopped: RuntimeError: no room; the run goes on without it",
        "logger=bad_curves stopped: ZeroDivisionError: division by zero; the run goes on without it",
        "logger=bad_end stopped: OSError: disk full; the run goes on without it",
    ):
        assert log.count(line) == 1
    assert log.count(" stopped: ") == 3
    assert tracked.metrics["status"] == "completed"


def test_no_network_is_attempted_and_nobody_is_asked(tracked):
    notes = tracked.folder / "notes.txt"
    assert not notes.exists(), notes.read_text()
    assert not tracked.proxy.visitors


def test_trackers_write_below_the_run_and_are_quiet(tracked):
    home = [path for path in (tracked.folder / "home").rglob("*") if path.is_file() and "wandb" in str(path).lower()]
    assert not home
    assert {path.name for path in tracked.folder.iterdir()} == {
        "plugins",
        "watching",
        "home",
        "picture.png",
        "my sweep",
    }
    assert "Warning" not in tracked.done.stderr
    said = [line for line in (tracked.done.stdout + tracked.done.stderr).splitlines() if "wandb: " in line]
    assert len(said) == 1
    assert f"to send this run: wandb sync '{tracked.run}/wandb/offline-run-" in said[0]


def test_csv_holds_the_curves(tracked):
    lines = (tracked.run / "curves" / "metrics.csv").read_text().splitlines()
    assert set(lines[0].split(",")) == {"loss/mse", "psnr", "seconds", "step"}
    assert lines[-1].endswith(",20")


def test_tensorboard_has_all_pictures_and_tables(tracked):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # noqa: PLC0415
    from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData  # noqa: PLC0415

    (events,) = (tracked.run / "tensorboard").glob("events.*")
    found = EventAccumulator(str(events), dict.fromkeys(("scalars", "images", "tensors"), 0)).Reload()
    for name in ("target", "painting"):
        (image,) = found.Images(name)
        assert image.step == 20
        shown = picture(io.BytesIO(image.encoded_image_string))
        assert np.array_equal(shown, picture(tracked.run / f"{name}.png"))
    steps = [image.step for image in found.Images("frames")]
    assert steps == sorted(steps)
    assert 4 <= len(steps) <= 8
    assert steps[0] == 0
    assert max(steps) < 20
    assert found.Scalars("loss/mse")[-1].step == 20
    assert found.Scalars("final/psnr")[0].value == pytest.approx(tracked.metrics["psnr"])
    texts = {
        name: b"".join(found.Tensors(f"{name}/text_summary")[0].tensor_proto.string_val).decode()
        for name in ("settings", "metrics", "files")
    }
    assert "    renderer:\n      plugin: analytic\n" in texts["settings"]
    assert f"| psnr | {tracked.metrics['psnr']} |" in texts["metrics"]
    assert f"| catalogue | {tracked.run / 'catalogue.h5'} |" in texts["files"]
    content = found.PluginTagToContent("hparams")["_hparams_/session_start_info"]
    chosen = HParamsPluginData.FromString(content).session_start_info.hparams
    assert {key: value.string_value for key, value in chosen.items()} == {
        "image": f"{tracked.folder}/picture.png", "steps": "20", "frames": "12", "threads": "1", "report": "False"
    }  # fmt: skip
    assert yaml.safe_load((events.parent / "hparams.yaml").read_text())["renderer"]["plugin"] == "analytic"


def test_wandb_has_all_pictures_the_table_and_the_catalogue(tracked):
    (kept,) = (tracked.run / "wandb").glob("offline-run-*")
    found = list(records(next(kept.glob("*.wandb"))))
    (run,) = [record.run for record in found if record.HasField("run")]
    assert (run.project, run.run_group, run.display_name, list(run.tags)) == ("brushexp", "my sweep", "0", ["a", "b"])
    assert run.notes == f"image={tracked.folder}/picture.png steps=20 frames=12 threads=1 report=False"
    config = {item.key: json.loads(item.value_json) for item in run.config.update}
    assert config["renderer"]["plugin"] == "analytic"
    assert config["steps"] == 20
    rows = [row_of(record.history.item) for record in found if record.HasField("history")]
    assert any(row.get("loss/mse") and row["trainer/global_step"] == 20 for row in rows)
    frames = [row for row in rows if "frames" in row]
    assert 4 <= len(frames) <= 8
    assert all((kept / "files" / row["frames"]["path"]).is_file() for row in frames)
    (last,) = [row for row in rows if "painting" in row]
    for name in ("target", "painting"):
        shown = picture(kept / "files" / last[name]["path"])
        assert np.array_equal(shown, picture(tracked.run / f"{name}.png"))
    table = json.loads((kept / "files" / last["metrics"]["path"]).read_text())
    assert dict(zip(table["columns"], table["data"][0], strict=True))["psnr"] == pytest.approx(tracked.metrics["psnr"])
    artifacts = [record.request.log_artifact.artifact for record in found if record.request.HasField("log_artifact")]
    artifacts += [record.artifact for record in found if record.HasField("artifact")]
    (catalogue,) = [artifact for artifact in artifacts if artifact.type == "catalogue"]
    assert [entry.path for entry in catalogue.manifest.contents] == ["catalogue.h5"]
    assert catalogue.manifest.contents[0].local_path == str(tracked.run / "catalogue.h5")
    (end,) = [record.exit for record in found if record.HasField("exit")]
    assert end.exit_code == 0


class Noting(Logger):
    """Notes what it is told, and fails where it should."""

    def __init__(self, fails: str = "") -> None:
        self.fails = fails
        self.told: list[str] = []
        self.end: Run | None = None

    def open(self, run):
        self.tell("open")
        return self

    def log_metrics(self, metrics, step):
        self.tell("curve")

    def save(self):
        self.tell("save")

    def finish(self, run):
        self.end = run
        self.tell("finish")

    def finalize(self, status):
        self.tell(status)

    def tell(self, word: str) -> None:
        self.told.append(word)
        if word == self.fails:
            raise ValueError(word)


def carried_out(tracker: Logger, error: BaseException | None = None) -> None:
    with Trackers({"noting": tracker}, Run(Path("x"))) as trackers:
        for step in range(2):
            for logger in trackers.loggers:
                logger.log_metrics({"a": 1.0}, step)
                logger.save()
        trackers.report({"psnr": 20.0, "ssim": math.inf, "status": "completed", "anytime": [[1.0, 20.0]]})
        if error is not None:
            raise error


@pytest.mark.parametrize(
    ("fails", "told"),
    [
        ("", ["open", "curve", "save", "curve", "save", "finish", "success"]),
        ("open", ["open", "finish"]),
        ("curve", ["open", "curve", "finish", "success"]),
        ("save", ["open", "curve", "save", "finish", "success"]),
        ("finish", ["open", "curve", "save", "curve", "save", "finish", "success"]),
        ("success", ["open", "curve", "save", "curve", "save", "finish", "success"]),
    ],
)
def test_a_tracker_that_failed_takes_no_more_curves_but_is_told_of_the_end(fails, told, caplog):
    tracker = Noting(fails)
    carried_out(tracker)
    assert tracker.told == told
    expected = [f"logger=noting stopped: ValueError: {fails}; the run goes on without it"] * bool(fails)
    assert [record.message for record in caplog.records if record.levelno == logging.WARNING] == expected


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (None, "completed"),
        (KeyboardInterrupt(), "interrupted"),
        (SystemExit(1), "interrupted"),
        (UserError("x; y"), "failed"),
    ],
)
def test_trackers_are_told_how_the_run_ended(error, status):
    tracker = Noting()
    with nullcontext() if error is None else pytest.raises(type(error)):
        carried_out(tracker, error)
    assert tracker.end.status == status
    assert tracker.end.numbers == {"psnr": 20.0}
    assert tracker.end.metrics["ssim"] is None


def test_a_tracker_that_is_not_installed_is_refused_before_the_work(config, monkeypatch):
    monkeypatch.setattr(tensorboard, "find_spec", lambda package: None)
    with pytest.raises(
        UserError, match=r"tensorboard needs the package tensorboard; pip install -e '\.\[tensorboard\]'"
    ):
        trackers_of(config("logger=tensorboard"), Path("x"))


def test_settings_name_plugins_as_the_command_line_does(config):
    found = settings_of(config("logger=[csv,tensorboard]", "renderer=textured", "loss=[mse,ssim]", "strokes=7"))
    assert found["renderer"]["plugin"] == "textured"
    assert found["loss"]["ssim"]["plugin"] == "ssim"
    assert found["strokes"] == 7
    assert list(found["logger"]) == ["csv", "tensorboard"]
    assert json.loads(json.dumps(found)) == found


def test_a_run_outside_of_the_program_is_called_after_its_folder(config, monkeypatch):
    monkeypatch.setattr("brushexp.app.tracking.HydraConfig.initialized", lambda: False)
    run = run_of(config(), Path("a/b"))
    assert (run.name, run.group, run.chosen) == ("b", "", {})


def test_a_part_of_a_run_has_a_name_of_its_own(config, monkeypatch):
    hydra = config_of_hydra("a/sweep/3", ["seed=1", "+x=[1,2]", "~logger.csv", "output=a/sweep"], RunMode.MULTIRUN)
    monkeypatch.setattr("brushexp.app.tracking.HydraConfig.initialized", lambda: True)
    monkeypatch.setattr("brushexp.app.tracking.HydraConfig.get", lambda: hydra)
    run = run_of(config(), Path("a/sweep/3/ratio_25"))
    assert (run.name, run.group, run.chosen) == ("3/ratio_25", "sweep", {"seed": "1", "x": "[1,2]"})


def config_of_hydra(folder: str, words: list[str], mode: RunMode) -> SimpleNamespace:
    return SimpleNamespace(runtime=SimpleNamespace(output_dir=folder), overrides=SimpleNamespace(task=words), mode=mode)


class FakeWandb:
    """As much of wandb as is needed to tell what it is asked for."""

    def __init__(self, **settings: object) -> None:
        self.__spec__ = self  # it counts as installed
        known = {"mode": "online", "api_key": None, "identity_token_file": None, "base_url": "https://api.wandb.ai"}
        self.settings = SimpleNamespace(**known | settings)
        self.exit_codes: list[int] = []
        self.begun: dict[str, object] = {}
        self.errors = SimpleNamespace(CommError=ConnectionError)

    def setup(self):
        return self

    def init(self, **options):
        self.begun = options
        if options["mode"] is None:
            raise ConnectionError("no network")
        return SimpleNamespace(
            define_metric=lambda *args, **options: None, url=None, offline=False, finish=self.finish, log=self.log
        )

    def finish(self, exit_code):
        self.exit_codes.append(exit_code)

    def log(self, values):
        raise RuntimeError("the service is gone")

    def Image(self, *args, **options):
        return args


@pytest.fixture
def account(monkeypatch, tmp_path):
    """Put a fake wandb in place of the real one; nobody is logged in."""
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))

    def known(**settings: object) -> FakeWandb:
        fake = FakeWandb(**settings)
        monkeypatch.setitem(sys.modules, "wandb", fake)
        return fake

    return known


def test_wandb_is_offline_unless_somebody_is_logged_in_or_says_otherwise(account, tmp_path):
    account()
    assert mode_of(Mode.auto) == "offline"
    assert mode_of(Mode.disabled) == "disabled"
    account(mode="disabled")  # WANDB_MODE
    assert mode_of(Mode.auto) is None
    account(api_key="x")
    assert mode_of(Mode.auto) is None
    assert mode_of(Mode.offline) == "offline"
    account()
    (tmp_path / "netrc").write_text("machine example.org login a password b\n")
    assert mode_of(Mode.auto) == "offline"
    (tmp_path / "netrc").write_text("machine api.wandb.ai login user password x\n")
    assert mode_of(Mode.auto) is None
    account(base_url="https://api.forge.coreweave.com")
    assert mode_of(Mode.auto) is None
    account(base_url="https://wandb.example.org")
    assert mode_of(Mode.auto) == "offline"
    (tmp_path / "netrc").write_text("what is this\n")
    assert mode_of(Mode.auto) == "offline"


def test_wandb_online_without_an_account_is_refused_before_the_work(account):
    account()
    with pytest.raises(UserError, match="nobody is logged in to wandb; run wandb login, or choose"):
        WeightsAndBiases(mode=Mode.online)


@pytest.mark.parametrize(("status", "code"), [("completed", 0), ("interrupted", 130), ("failed", 1)])
def test_wandb_is_finished_however_the_run_ends(account, status, code, tmp_path):
    fake = account()
    tracker = WeightsAndBiases(group="mine", entity="me")
    tracker.open(Run(tmp_path, name="3", group="sweep"))
    assert (fake.begun["group"], fake.begun["name"], fake.begun["entity"]) == ("mine", "3", "me")
    assert fake.begun["mode"] == "offline"
    with pytest.raises(RuntimeError, match="the service is gone"):
        tracker.finish(Run(tmp_path, status=status, pictures={"target": tmp_path / "target.png"}))
    assert fake.exit_codes == [code]
    assert "WANDB_DATA_DIR" not in os.environ


def test_wandb_goes_offline_when_it_cannot_be_reached(account, tmp_path, caplog):
    fake = account(api_key="x")
    WeightsAndBiases().open(Run(tmp_path))
    assert fake.begun["mode"] == "offline"
    assert "wandb cannot be reached, so this run is kept offline: no network" in caplog.text
