"""Test that trackers receive a run's data, and use the network only if requested."""

import io
import json
import os
import socket
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import program
import pytest
import yaml
from brushexp_integrations.tensorboard import TensorBoard
from brushexp_integrations.wandb import WeightsAndBiases, mode_of
from films import pixels_of
from refusals import refuses

from brushexp.plugins.logger.base import Run
from brushexp.system.files import write_picture

pytestmark = pytest.mark.slow
PROXIES = ("http_proxy", "https_proxy", "all_proxy")


@pytest.fixture(scope="module")
def tracked(tmp_path_factory) -> SimpleNamespace:
    """Run a sweep of one job with every tracker; a proxy detects any network traffic."""
    folder = tmp_path_factory.mktemp("tracked")
    (folder / "home").mkdir()
    rows, columns = np.mgrid[:40, :56]
    write_picture(folder / "picture.png", np.stack([4 * columns, 6 * rows, 255 - 4 * columns], -1).astype(np.uint8))
    settings = ["steps=20", "frames=12", "threads=1", "report=false", f"output={folder}/my sweep"]
    loggers = ["logger=[csv,tensorboard,wandb]", "logger.wandb.tags=[a,b]"]
    with socket.create_server(("127.0.0.1", 0)) as proxy, pytest.MonkeyPatch.context() as patch:
        proxy.setblocking(False)
        url = f"http://127.0.0.1:{proxy.getsockname()[1]}"
        environment = {key: value for name in PROXIES for key, value in ((name, url), (name.upper(), url))}
        environment |= {"no_proxy": "", "NO_PROXY": "", "HOME": str(folder / "home")}
        environment["MPLCONFIGDIR"] = str(Path.home() / ".cache" / "matplotlib")  # a search for fonts takes seconds
        for name in [name for name in os.environ if name.startswith("WANDB_")]:
            patch.delenv(name)
        words = ["hydra.mode=MULTIRUN", f"image={folder}/picture.png", *settings, *loggers]
        done = program.run(*words, cwd=folder, **environment)
        assert done.returncode == 0, done.stderr
        with pytest.raises(BlockingIOError):
            proxy.accept()  # no connection was made
    run = folder / "my sweep" / "0"
    metrics = json.loads((run / "metrics.json").read_text())
    return SimpleNamespace(folder=folder, run=run, metrics=metrics, said=done.stdout + done.stderr)


def records(path: Path) -> Iterator:
    """Yield the records of a .wandb file, a LevelDB log that splits messages across blocks of 32 KiB."""
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
        if kind in (1, 4):  # a whole message, or its last piece
            yield Record.FromString(message)
            message = b""


def test_trackers_write_below_the_run_and_are_quiet(tracked):
    assert " stopped: " not in (tracked.run / "run.log").read_text()
    assert not [path for path in (tracked.folder / "home").rglob("*") if "wandb" in str(path).lower()]
    assert {path.name for path in tracked.folder.iterdir()} == {"home", "picture.png", "my sweep"}
    assert "Warning" not in tracked.said
    (line,) = [line for line in tracked.said.splitlines() if "wandb: " in line]
    assert f"to send this run: wandb sync '{tracked.run}/wandb/offline-run-" in line
    lines = (tracked.run / "curves" / "metrics.csv").read_text().splitlines()
    assert set(lines[0].split(",")) == {"loss/curvature", "loss/mse", "psnr", "seconds", "step"}
    assert lines[-1].endswith(",19")


def test_tensorboard_has_all_pictures_and_tables(tracked):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator  # noqa: PLC0415
    from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData  # noqa: PLC0415

    (events,) = (tracked.run / "tensorboard").glob("events.*")
    result = EventAccumulator(str(events), dict.fromkeys(("scalars", "images", "tensors"), 0)).Reload()
    for name in ("target", "painting"):
        (image,) = result.Images(name)
        assert image.step == 20
        assert np.array_equal(pixels_of(io.BytesIO(image.encoded_image_string)), pixels_of(tracked.run / f"{name}.png"))
    first, *steps = [image.step for image in result.Images("frames")]
    assert 3 <= len(steps) <= 7
    assert first == 0 < steps[0] <= steps[-1] < 20
    assert result.Scalars("loss/mse")[-1].step == 19
    assert result.Scalars("final/psnr")[0].value == pytest.approx(tracked.metrics["psnr"])
    texts = {
        name: b"".join(result.Tensors(f"{name}/text_summary")[0].tensor_proto.string_val).decode()
        for name in ("settings", "metrics", "files")
    }
    assert "\nrenderer:\n  _target_: renderer/analytic\n" in texts["settings"]
    assert f"| psnr | {tracked.metrics['psnr']} |" in texts["metrics"]
    assert f"| catalogue | {tracked.run / 'catalogue.h5'} |" in texts["files"]
    content = result.PluginTagToContent("hparams")["_hparams_/session_start_info"]
    chosen = HParamsPluginData.FromString(content).session_start_info.hparams
    assert {key: value.string_value for key, value in chosen.items()} == {
        "look": "plain", "image": f"{tracked.folder}/picture.png", "steps": "20", "frames": "12", "threads": "1",
        "report": "False",
    }  # fmt: skip
    assert yaml.safe_load((events.parent / "hparams.yaml").read_text())["steps"] == 20


def test_wandb_has_all_pictures_the_table_and_the_catalogue(tracked):
    (kept,) = (tracked.run / "wandb").glob("offline-run-*")
    result = list(records(next(kept.glob("*.wandb"))))
    (run,) = [record.run for record in result if record.HasField("run")]
    assert (run.project, run.run_group, run.display_name, list(run.tags)) == ("brushexp", "my sweep", "0", ["a", "b"])
    assert run.notes == f"look=plain image={tracked.folder}/picture.png steps=20 frames=12 threads=1 report=False"
    config = {item.key: json.loads(item.value_json) for item in run.config.update}
    assert (config["renderer"]["soft"], config["steps"]) == (1.5, 20)
    rows = [
        {".".join(item.nested_key): json.loads(item.value_json) for item in record.history.item}
        for record in result
        if record.HasField("history")
    ]
    assert any(row.get("loss/mse") and row["trainer/global_step"] == 19 for row in rows)
    frames = [row["frames.path"] for row in rows if "frames.path" in row]
    assert 4 <= len(frames) <= 8
    assert all((kept / "files" / path).is_file() for path in frames)
    (last,) = [row for row in rows if "painting.path" in row]
    for name in ("target", "painting"):
        assert np.array_equal(pixels_of(kept / "files" / last[f"{name}.path"]), pixels_of(tracked.run / f"{name}.png"))
    table = json.loads((kept / "files" / last["metrics.path"]).read_text())
    assert dict(zip(table["columns"], table["data"][0], strict=True))["psnr"] == pytest.approx(tracked.metrics["psnr"])
    (catalogue,) = [record.artifact.manifest for record in result if record.artifact.type == "catalogue"]
    (entry,) = catalogue.contents
    assert (entry.path, entry.local_path) == ("catalogue.h5", str(tracked.run / "catalogue.h5"))
    (end,) = [record.exit for record in result if record.HasField("exit")]
    assert end.exit_code == 0


@pytest.mark.parametrize(("name", "tracker"), [("tensorboard", TensorBoard), ("wandb", WeightsAndBiases)])
def test_a_tracker_that_is_not_installed_is_refused_when_it_is_built(name, tracker, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)  # makes the package unavailable
    refuses(rf"needs the package {name}; pip install 'brushexp\[{name}\]'", tracker)


class FakeWandb:
    """A stand-in for wandb that needs no network, and records how it is called."""

    def __init__(self, **settings: object) -> None:
        self.__spec__ = self  # makes the package count as installed
        known = {"mode": "online", "api_key": None, "identity_token_file": None, "base_url": "https://api.wandb.ai"}
        self.settings = SimpleNamespace(**known | settings)
        self.errors = SimpleNamespace(CommError=ConnectionError)
        self.begun: dict[str, object] = {}
        self.exit_codes: list[int] = []

    def setup(self):
        return self

    def init(self, **options):
        self.begun = options
        if options["mode"] is None:
            raise ConnectionError("no network")
        ignore = lambda *args, **options: None  # noqa: E731
        return SimpleNamespace(url=None, offline=False, define_metric=ignore, finish=self.finish)  # without log()

    def finish(self, exit_code):
        self.exit_codes.append(exit_code)

    def Image(self, *args, **options):
        return args


@pytest.fixture
def account(monkeypatch, tmp_path):
    """Return a function that replaces wandb with a fake that has given settings; no user is logged in."""
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))

    def known(**settings: object) -> FakeWandb:
        fake = FakeWandb(**settings)
        monkeypatch.setitem(sys.modules, "wandb", fake)
        return fake

    return known


@pytest.mark.parametrize(("settings", "netrc", "mode"), [
    ({}, None, "offline"),
    ({"mode": "disabled"}, None, None),  # WANDB_MODE
    ({"api_key": "x"}, None, None),
    ({}, "machine example.org login a password b", "offline"),
    ({}, "machine api.wandb.ai login user password x", None),
    ({"base_url": "https://api.forge.coreweave.com"}, "machine api.wandb.ai login user password x", None),
    ({"base_url": "https://wandb.example.org"}, "machine api.wandb.ai login user password x", "offline"),
])  # fmt: skip
def test_wandb_is_offline_unless_somebody_is_logged_in_or_says_otherwise(account, settings, netrc, mode, tmp_path):
    account(**settings)
    if netrc is not None:
        (tmp_path / "netrc").write_text(netrc)
    assert mode_of("auto") == mode
    assert mode_of("disabled") == "disabled"


def test_wandb_without_an_account_is_refused_before_the_work_and_offline_when_it_cannot_be_reached(
    account, tmp_path, caplog
):
    account()
    refuses("nobody is logged in to wandb; run wandb login, or choose", WeightsAndBiases, mode="online")
    fake = account(api_key="x")
    WeightsAndBiases().open(Run(tmp_path))
    assert fake.begun["mode"] == "offline"
    assert "wandb cannot be reached, so this run is kept offline: no network" in caplog.text


@pytest.mark.parametrize(("status", "code"), [("completed", 0), ("interrupted", 130), ("failed", 1)])
def test_wandb_is_finished_however_the_run_ends(account, status, code, tmp_path):
    fake = account()
    tracker = WeightsAndBiases(group="mine", entity="me")
    tracker.open(Run(tmp_path, name="3", group="sweep"))
    assert (fake.begun["group"], fake.begun["name"], fake.begun["entity"]) == ("mine", "3", "me")
    assert fake.begun["mode"] == "offline"
    with pytest.raises(AttributeError, match="log"):
        tracker.finish(Run(tmp_path, status=status, pictures={"target": tmp_path / "target.png"}))
    assert fake.exit_codes == [code]
