"""Fuzz tests of damaged or malicious files: each yields finite content or a one-line refusal; no code in them runs."""

import copy
import json
import math
import os
import random
import sys
import time
import zlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import lightning as L
import numpy as np
import pytest
import torch
from brushexp_studio.view import read_painting
from brushexp_thesis.claims import read_claims
from brushexp_thesis.published import read_published
from brushexp_training.renderers.neural import Neural
from catalogues import catalogue
from hydra.errors import CompactHydraException
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from painters import QUIET, fit, painter_of
from PIL import Image, ImageCms
from refusals import refuses
from safetensors.torch import save
from sweeps import make_run
from test_dataset import read_all, write
from test_leaderboard import PUBLISHED
from test_verdicts import CLAIMS
from tifffile import imwrite

from brushexp.compat.hydra import shared_store
from brushexp.config.check import check
from brushexp.config.compose import compose_config, folders_of
from brushexp.config.mistakes import explanation
from brushexp.config.publish import prepare
from brushexp.errors import UserError
from brushexp.features.base import read_tensors
from brushexp.pages.run_page import page_in
from brushexp.pages.sweep_page import write_sweep_page
from brushexp.painting.components import build_components
from brushexp.painting.reopen import export_job
from brushexp.pictures.load import load_picture
from brushexp.plugins.renderer.base import RENDERERS
from brushexp.registry import build_named
from brushexp.registry.options import options_of
from brushexp.results.runs import JOBS, gather
from brushexp.runs import resume
from brushexp.runs.resume import RECORD_KEY, RunRecord, interrupted_run
from brushexp.runs.sweep_jobs import check_same
from brushexp.runs.trainer import fit as fit_module
from brushexp.strokes.catalogue import check_strokes
from brushexp.strokes.storage import load_catalogue, save_catalogue
from brushexp.system.hdf5 import encode_fixed, numbers_of
from brushexp.system.run_files import CHECKPOINT

EXAMPLES = int(os.environ.get("BRUSHEXP_FUZZ", "12"))  # examples of damage per kind of file; use thousands to search
SLOWEST = 30  # seconds of CPU time that a file may take
SLOW = 6  # ratio of examples for other kinds to those for kinds read into a whole page or fit
DEEP = "[" * 40_000
CODE = {"_target_": "os.system", "_args_": ["touch ran"]}
BOMB = "a: &a [1]\n" + "".join(f"{y}: &{y} [{', '.join([f'*{x}'] * 9)}]\n" for x, y in pairwise("abcdefghi"))
WORDS = (DEEP, f"a: {DEEP}", BOMB, "!!python/object/apply:os.system ['touch ran']", "{a: 1, a: 2}", "just words", "\t")
NUMBERS = (float("nan"), float("inf"), -1, 0, 1, 0.5, 2**63, 10**400, 1e308, True, None)
HOSTILE = (
    *(*NUMBERS, *WORDS, "", "x" * 5000, "../../x", "\0", "é\ud800", "${oc.env:HOME}", "${", "???", "2024-99-99"),
    *([], {}, [[]], {"": ""}, CODE, {"a": CODE}, [1] * 500, [[0.5] * 3] * 3),
)
TINY = {"brushes": 2, "code": 1, "dense": 2, "width": 1, "stages": 1}  # options of a network
TWO = [["steps=1"], ["steps=2"]]  # words of two jobs
LOOK = """# @package _global_
# mine
defaults: [{override /loss: [mse, width]}]
steps: 5
light: {depth: 0.5}
optimizer: {lr: 0.01, units: {position: 0.4}}
loss: {width: {weight: 0.1}}
"""
SETTINGS: dict[str, Any] = {}  # of a run, once composed
FORBIDDEN = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect")
happened: list[str] = []  # forbidden events while reading
sys.addaudithook(lambda event, arguments: happened.append(f"{event}{arguments}") if event in FORBIDDEN else None)


def assert_all(values: Iterable[Any]) -> None:
    assert all(map(bool, values))


# Good files of every kind, and functions that read each to its end.


def write_catalogue(folder: Path) -> Path:
    save_catalogue(folder / "catalogue.h5", catalogue())
    return folder / "catalogue.h5"


def write_text(folder: Path) -> Path:
    return build_named("to", "json", {}).write(export_job(catalogue(3)), folder)[0]


def read_catalogue(path: Path) -> None:
    saved = load_catalogue(path)
    check_strokes(saved.strokes)
    assert sorted(saved.depth.tolist()) == list(range(len(saved.strokes)))
    assert bool(((saved.background >= 0) & (saved.background <= 1)).all())
    export_job(saved)


def write_weights(folder: Path) -> Path:
    options = {name: default for name, _, default in options_of(Neural)} | TINY
    RENDERERS.save(folder / "it", "neural", Neural(**TINY, checkpoint=None), {"options": options})
    return folder / "it.safetensors"


def read_weights(path: Path) -> None:
    renderer = build_named("renderer", "neural", TINY | {"checkpoint": str(path.with_suffix(".safetensors"))})
    assert_all(value.isfinite().all() for value in renderer.state_dict().values())


def write_table(folder: Path) -> Path:
    torch.save({"a": torch.rand(3, 4), "b": torch.ones(2)}, folder / "it.pth")
    return folder / "it.pth"


def write_checkpoint(folder: Path) -> Path:
    path = folder / CHECKPOINT
    fit(painter_of(n=8, size=(12, 16), steps=3), max_steps=1).save_checkpoint(path)
    torch.save(torch.load(path) | {RECORD_KEY: {"settings": SETTINGS, "files": {}, "inputs": {}, "words": []}}, path)
    return path


def read_checkpoint(path: Path) -> None:
    build_components(interrupted_run(path.parent, OmegaConf.create(SETTINGS))[0])
    painter = painter_of(n=8, size=(12, 16), steps=3)
    fit_module(
        L.Trainer(**QUIET, callbacks=[RunRecord(OmegaConf.create({"task": "paint"}), path.parent)]), painter, None, path
    )
    check_strokes(painter.strokes())


def part(name: str) -> Callable[[Path], Path]:
    """Return a function that writes a run and returns the path of one of its files."""

    def write_run(folder: Path) -> Path:
        metrics = {"psnr": 20.0, "ssim": 0.5, "l1": 0.1, "seconds": 1.0, "n_strokes": 3, "steps": 9, "device": "cpu"}
        metrics |= {"status": "completed", "anytime": [[0.0, 10.0], [1.0, 20.0]], "loss": "mse"}
        run = make_run(folder, {"steps": "9"}, name="0", target=90, color=80, size=(30, 50), **metrics)
        save_catalogue(run / "catalogue.h5", catalogue(30))
        text(".hydra/overrides.yaml", "- steps=9\n- loss=mse\n")(run)
        text(".hydra/config.yaml", "image: a.png\nsteps: 9\nloss: {mse: {weight: 1.0}}\n")(run)
        text("curves/metrics.csv", "step,seconds,psnr,loss/mse\n0,0.0,10,0.1\n1,0.1,12,0.05\n")(run)
        return run / name

    return write_run


def read_run(path: Path) -> None:
    folder = next(folder for folder in path.parents if folder.name == "0")
    page_in(folder, read_painting(folder, export_job(load_catalogue(folder / "catalogue.h5"))))


def read_sweep(path: Path) -> None:
    sweep = next(folder.parent for folder in path.parents if folder.name == "0")
    write_sweep_page(sweep, gather([sweep], sweep))


def text(name: str, content: str) -> Callable[[Path], Path]:
    def write_content(folder: Path) -> Path:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
        return folder / name

    return write_content


def read_look(path: Path) -> None:
    """Read a user's own look, but skip looks with YAML anchors, which users may nest in their own files."""
    if path.is_file() and "&" in path.read_text(errors="replace"):
        return
    folders, words = folders_of(path.parents[2]), ["look=own"]
    try:
        with shared_store():
            prepare(path.parents[2], words)
            check(compose_config(words, folders), words)
    except (CompactHydraException, OmegaConfBaseException) as error:
        raise UserError(explanation(error, folders, words)) from error


def picture(suffix: str) -> Callable[[Path], Path]:
    def write_image(folder: Path) -> Path:
        path, pixels = folder / f"a.{suffix}", np.random.default_rng(0).integers(0, 255, (9, 13, 3), np.uint8)
        if suffix == "tiff":  # read by tifffile
            imwrite(path, pixels.astype(np.uint16) * 256, photometric="rgb")
            return path
        extra: dict[str, Any] = {}
        if suffix == "jpg":
            extra = {"icc_profile": ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()}
            extra["exif"] = Image.Exif()
            extra["exif"][274] = 6
        Image.fromarray(pixels).save(path, **extra)
        return path

    return write_image


def read_image(path: Path) -> None:
    image = load_picture(str(path), 16)
    assert bool(((image >= 0) & (image <= 1)).all())


OF_RUN = ("metrics.json", "curves/metrics.csv", "target.png")
OF_SWEEP = (".hydra/overrides.yaml", ".hydra/config.yaml")
KINDS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], None]]] = {
    "catalogue": (write_catalogue, read_catalogue),
    "text": (write_text, read_catalogue),
    "set": (
        lambda folder: write(folder / "set", n=40) / "000000000.h5",
        lambda path: assert_all((np.abs(read_all(path)[2]) <= 1).flat),
    ),
    "weights": (write_weights, read_weights),
    "recipe": (lambda folder: write_weights(folder).with_suffix(".json"), read_weights),
    "figures": (
        text("figures.yaml", PUBLISHED),
        lambda path: assert_all(math.isfinite(x) for one in read_published(path) for x in one.figures.values()),
    ),
    "claims": (
        text("claims.yaml", CLAIMS),
        lambda path: assert_all(
            one.at_least > 0 and (one.metric or one.cannot or one.needs)
            for claims in read_claims(path).values()
            for one in claims
        ),
    ),
    "jobs": (
        text(JOBS, json.dumps({"typed": ["steps=1,2"], "jobs": TWO})),
        lambda path: check_same(path.parents[1], TWO),
    ),
    "look": (text("conf/look/own.yaml", LOOK), read_look),
    "table": (write_table, lambda path: assert_all(x.isfinite().all() for x in read_tensors(path).values())),
    "checkpoint": (write_checkpoint, read_checkpoint),
    **{name: (part(name), read_run) for name in OF_RUN},
    **{name: (part(name), read_sweep) for name in OF_SWEEP},
    **{
        suffix: (picture(suffix), read_image)
        for suffix in ("png", "jpg", "gif", "webp", "avif", "jp2", "bmp", "tif", "tiff", "ppm", "tga", "qoi")
    },
}


# Ways to damage files.


def edited(path: Path, chance: random.Random) -> None:
    """Duplicate, delete or replace a piece of the file, flip one bit, or truncate it."""
    data = path.read_bytes()
    first, last, place = sorted(chance.randrange(len(data)) for _ in range(3))
    bit = bytes([data[first] ^ 1 << chance.randrange(8)])
    pieces = [data[first:last], b"", bytes(last - first), b"\xff" * 8, b"9" * 20, DEEP.encode(), b"NaN", bit, bit]
    piece = chance.choice(pieces)
    behind = chance.choice([data[place:], data[last:], data[first:], data[first + len(piece) :], b""])
    path.write_bytes(data[:first] + piece + behind)


def worded(path: Path, chance: random.Random) -> None:
    path.write_text(chance.choice([*WORDS, "", "[1, 2]", "{}", "null", '{"a": 1, "a": 2}', "\x80\x04."]))


def rewritten(path: Path, chance: random.Random) -> None:
    """Replace one part of the file, but keep its format valid."""
    if path.suffix in (".json", ".yaml"):
        path.write_text(json.dumps(changed(OmegaConf.to_container(OmegaConf.load(path)), chance)))
    elif path.suffix in (".pth", ".ckpt"):
        with suppress(AttributeError, TypeError, NotImplementedError):  # some tensors cannot be made or stored
            stored = BytesIO()
            torch.save(changed(torch.load(path), chance), stored)
            path.write_bytes(stored.getvalue())
    elif path.suffix == ".h5":
        with h5py.File(path, "a") as file, suppress(TypeError, OverflowError, ValueError):
            change_hdf5(file, chance, path.parent)
    elif path.suffix == ".safetensors":
        tensors = {"a": torch.full((3,), torch.nan), "b": torch.ones(2, 2).to(torch.float8_e4m3fn)}
        path.write_bytes(save({key: tensors[key] for key in chance.sample(list(tensors), chance.randrange(3))}))


def changed(tree: Any, chance: random.Random) -> Any:
    """Return nested data with one value replaced or deleted."""
    if isinstance(tree, dict | list) and tree and chance.random() < 0.85:
        tree = copy.copy(tree)
        key = chance.choice(list(tree) if isinstance(tree, dict) else range(len(tree)))
        if chance.random() < 0.1:
            del tree[key]
        else:
            tree[key] = changed(tree[key], chance)
        return tree
    if isinstance(tree, torch.Tensor) and chance.random() < 0.8:
        wrong = [tree * torch.nan, tree.reshape(-1)[:0], tree.expand(7, *tree.shape), tree.double()]
        wrong += [tree.to(torch.complex64), tree.to("meta"), torch.sparse_coo_tensor(size=(10**9,))]
        return chance.choice([*wrong, torch.ones(1).expand(10**12)])
    return chance.choice(HOSTILE)


def change_hdf5(file: h5py.File, chance: random.Random, folder: Path) -> None:
    if chance.random() < 0.5:
        value = chance.choice(HOSTILE)
        long = isinstance(value, str) and chance.random() < 0.8
        file.attrs[chance.choice(list(file.attrs))] = encode_fixed(value) if long else value
        return
    name = chance.choice(list(file))
    held = file[name][()]
    (n, *row), kind, blocks = held.shape, held.dtype, (min(16, len(held)), *held.shape[1:])
    packed = {"chunks": blocks, "compression": "gzip", "shuffle": True, "fletcher32": True, "maxshape": (None, *row)}
    elsewhere = h5py.VirtualLayout(shape=held.shape, dtype=kind)
    elsewhere[...] = h5py.VirtualSource(str(folder / "other.h5"), name, shape=held.shape)
    del file[name]
    ways: list[Callable[[], object]] = [
        lambda: file.create_dataset(name, shape=(10**8, *row), dtype=kind, **packed),
        lambda: file.create_dataset(name, shape=(n, *row), dtype=kind, external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)]),
        lambda: file.create_virtual_dataset(name, elsewhere),
        lambda: file.create_dataset(name, data=held, compression="lzf", chunks=blocks),
        lambda: file.create_dataset(
            name, data=np.full(held.shape, np.nan if kind.kind == "f" else 250, kind), **packed
        ),
        lambda: file.create_dataset(name, data=chance.choice([held[:0], held.astype("f8"), held.tobytes()])),
        lambda: file.create_group(name),
        lambda: file.__setitem__(name, h5py.ExternalLink(str(folder / "other.h5"), "/x")),
        lambda: file.__setitem__(name, h5py.SoftLink(f"/{name}")),
    ]
    chance.choice(ways)()
    if isinstance(file.get(name, getlink=True), h5py.HardLink):
        file[name].attrs["unit"] = encode_fixed("x")


def test_a_chunk_that_unpacks_to_more_than_it_says_is_refused_before_there_is_room_for_it(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        made = file.create_dataset("it", (16,), np.float32, chunks=(16,), compression="gzip", shuffle=True)
        made.id.write_direct_chunk((0,), zlib.compress(bytes(2**22)))
        whole = file.create_dataset("whole", data=np.arange(99.0), chunks=(16,), compression="gzip", fletcher32=True)
        refuses("it has a chunk that unpacks to more than its stated 64 bytes", numbers_of, made)
        assert numbers_of(whole).tolist() == list(range(99))


WAYS = (edited, worded, rewritten)


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Callable[[str], Path]:
    """Return a function that restores a valid file of a kind; each kind is written only once."""

    @cache
    def written(kind: str) -> tuple[Path, bytes]:
        write, read = KINDS[kind]
        path = write(tmp_path_factory.mktemp(kind.replace("/", "_")))
        read(path)  # imports what it needs
        return path, path.read_bytes()

    def of_kind(kind: str) -> Path:
        path, data = written(kind)
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        path.unlink(missing_ok=True)
        path.write_bytes(data)
        return path

    return of_kind


@pytest.fixture(autouse=True)
def _composed(config, monkeypatch, tmp_path):
    if not SETTINGS:
        SETTINGS.update(OmegaConf.to_container(config("steps=3"), resolve=True, enum_to_str=True))
    output = SimpleNamespace(output_dir=str(tmp_path))
    hydra = SimpleNamespace(overrides=SimpleNamespace(task=[]), runtime=output)
    (tmp_path / ".hydra").mkdir()
    monkeypatch.setattr(resume, "HydraConfig", SimpleNamespace(get=lambda: hydra))
    monkeypatch.setattr(resume, "provenance_of", lambda _: {"version": "0"})  # the real function asks git, in a process


def attempt(kind: str, path: Path) -> str:
    """Read a file, and return the one-line refusal, or an empty string if the file is readable."""
    happened.clear()
    message, start = "", time.process_time()
    try:
        KINDS[kind][1](path)
    except UserError as error:
        message = str(error)
    assert time.process_time() - start < SLOWEST, path
    assert not happened
    assert not Path("ran").exists()
    assert "\n" not in message, message[:200]
    assert len(message) < 1000 + 5 * len(str(path)), message[:200]
    return message


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_to_finite_content_or_refused_in_one_line(kind, good):
    slow = kind in ("checkpoint", *OF_RUN, *OF_SWEEP)

    @settings(max_examples=-(-EXAMPLES // SLOW) if slow else EXAMPLES, deadline=None, database=None)
    @given(st.sampled_from(WAYS), st.randoms(use_true_random=False))
    def damage_and_read(way, chance):
        path = good(kind)
        way(path, chance)
        attempt(kind, path)

    damage_and_read()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_is_not_waited_for(kind, good):
    page = kind in (*OF_RUN, *OF_SWEEP)  # can be made without them
    for make in (os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero"), lambda path: path.symlink_to(path)):
        if not page or make is os.mkfifo:
            path = good(kind)
            path.unlink()
            make(path)
            assert attempt(kind, path) or page
