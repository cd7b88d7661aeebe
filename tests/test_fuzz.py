"""Files that were damaged, or made to mislead: each is read to finite content or refused in one line, and runs nothing."""

import copy
import json
import os
import pickle
import random
import sys
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import torch
from catalogues import catalogue
from omegaconf import OmegaConf
from painters import fit, painter_of
from PIL import Image
from safetensors.torch import save
from test_dataset import read_all, write

from brushexp.app import fitting
from brushexp.app.fitting import CHECKPOINT, RECORD, interrupted_run
from brushexp.errors import UserError
from brushexp.features.base import read_tensors
from brushexp.painting.outputs import painted_with, renderer_of
from brushexp.pictures.decode import read_picture
from brushexp.plugins.renderer.base import RENDERERS
from brushexp.plugins.renderer.neural import Neural
from brushexp.registry import build_named
from brushexp.results.page.run import write_run_page
from brushexp.results.page.sweep_page import write_sweep_page
from brushexp.results.runs import gather
from brushexp.results.tables import write_run_tables
from brushexp.strokes.catalogue import check_strokes
from brushexp.strokes.storage import load_catalogue, save_catalogue
from brushexp.system.checkpoint import plain_options
from brushexp.system.files import write_json, write_picture
from brushexp.system.hdf5 import fixed

CASES = int(os.environ.get("BRUSHEXP_FUZZ", "12"))  # of each kind of file and of damage: thousands to search for more
DEEP = "[" * 20_000
RUN = {"_target_": "os.system", "_args_": ["touch ran"]}
HOSTILE = [
    *(float("nan"), float("inf"), -1, 0, 1, 0.5, 2**63, 10**400, 1e308, True, None, "", "x" * 5000, "../../x", "\0", "é\ud800"),
    *([], {}, [[]], {"": ""}, RUN, {"a": RUN}, "${oc.env:HOME}", "${", "???", "2024-99-99", [1] * 500, [[0.5] * 3] * 3),
]  # fmt: skip
WORDS = (DEEP, "!!python/object/apply:os.system ['touch ran']", "&a [*a, *a]", "&a {b: &c [1]}\nd: [*a, *c]", "{a: 1, a: 2}", "\t")
FORBIDDEN = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect", "ctypes.dlopen")
events: list[str] = []  # of which the interpreter tells while something is read
watching = False


def watch(event: str, arguments: tuple) -> None:
    if watching and event in FORBIDDEN:
        events.append(f"{event}{arguments}")


sys.addaudithook(watch)


# What is damaged: files by the kind, and what reads each to the end.


def write_catalogue(folder: Path) -> Path:
    save_catalogue(folder / "catalogue.h5", catalogue())
    return folder / "catalogue.h5"


def write_text_catalogue(folder: Path) -> Path:
    saved = catalogue(3)
    values = {name: value.tolist() for name, value in saved.strokes.items()}
    rows = [{name: value[k] for name, value in values.items()} | {"depth": k} for k in range(3)]
    head = {"format": "brushexp catalogue", "format_version": 1, "height": 30, "width": 50, "renderer": "analytic"}
    head |= {"renderer_hash": "", "seed": 3, "background": [0, 0, 1], "config": saved.config.splitlines()}
    write_json(folder / "strokes.json", head | {"strokes": rows})
    return folder / "strokes.json"


def read_catalogue(path: Path) -> None:
    saved = load_catalogue(path)
    check_strokes(saved.strokes)
    assert sorted(saved.depth.tolist()) == list(range(len(saved.strokes)))
    assert bool(((saved.background >= 0) & (saved.background <= 1)).all())
    painted_with(saved)
    renderer_of(saved)


def write_set(folder: Path) -> Path:
    return write(folder / "set", n=40) / "000000000.h5"


def read_set(path: Path) -> None:
    parameters = read_all(path)[2]
    assert bool((np.abs(parameters) <= 1).all())


def write_weights(folder: Path) -> Path:
    options = {"width": 1, "widest": 2, "dense": [2], "coordconv": "none", "checkpoint": None}
    network = Neural(**options)
    RENDERERS.save(folder / "it", "neural", network, {"options": plain_options(options), "data": {}, "training": {}})
    return folder / "it.safetensors"


def read_weights(path: Path) -> None:
    options = {"width": 1, "widest": 2, "dense": [2], "coordconv": "none"}
    network = build_named("renderer", "neural", options | {"checkpoint": str(path.with_suffix(".safetensors"))})
    assert all(bool(value.isfinite().all()) for value in network.state_dict().values())


def write_recipe(folder: Path) -> Path:
    return write_weights(folder).with_suffix(".json")


def write_table(folder: Path) -> Path:
    torch.save({"a": torch.rand(3, 4), "b": torch.ones(2)}, folder / "it.pth")
    return folder / "it.pth"


def read_table(path: Path) -> None:
    assert all(bool(value.isfinite().all()) for value in read_tensors(path).values())


def settings_of(config) -> dict:
    return OmegaConf.to_container(config("steps=9", "resume=x"), resolve=True, enum_to_str=True)


def write_checkpoint(folder: Path) -> Path:
    trainer = fit(painter_of(n=8, size=(12, 16), steps=9), max_steps=1)
    trainer.save_checkpoint(folder / CHECKPOINT)
    saved = torch.load(folder / CHECKPOINT, weights_only=True)
    torch.save(saved | {RECORD: {"settings": SETTINGS, "files": {}}}, folder / CHECKPOINT)
    return folder / CHECKPOINT


SETTINGS: dict = {}


def read_checkpoint(path: Path) -> None:
    kept = interrupted_run(path.parent, OmegaConf.create(SETTINGS))[1]
    for family in ("renderer", "blend", "order", "density", "sampler", "optimizer"):
        from brushexp.registry import build

        build(kept[family])


def write_run(folder: Path) -> Path:
    """A run's folder."""
    run = folder / "0"
    (run / ".hydra").mkdir(parents=True)
    (run / "curves").mkdir()
    save_catalogue(run / "catalogue.h5", catalogue(30))
    metrics = {"psnr": 20.0, "ssim": 0.5, "l1": 0.1, "seconds": 1.0, "n_strokes": 3, "steps": 9, "status": "completed"}
    metrics |= {"device": "cpu", "anytime": [[0.0, 10.0], [1.0, 20.0]]}
    write_json(run / "metrics.json", metrics)
    write_json(run / "result.json", metrics | {"run": "0", "overrides": {"steps": "9"}, "loss": "mse"})
    write_picture(run / "target.png", np.full((30, 50, 3), 90, np.uint8))
    write_picture(run / "painting.png", np.full((30, 50, 3), 80, np.uint8))
    (run / ".hydra" / "overrides.yaml").write_text("- steps=9\n- loss=mse\n")
    (run / ".hydra" / "config.yaml").write_text("image: a.png\nsteps: 9\nloss: {mse: {weight: 1.0}}\n")
    (run / "curves" / "metrics.csv").write_text("step,seconds,psnr,loss/mse\n0,0.0,10,0.1\n1,0.1,12,0.05\n")
    return run


def read_run(path: Path) -> None:
    run = next(folder for folder in path.parents if folder.name == "0")
    write_run_page(run)
    runs = gather([run.parent], run.parent)
    write_sweep_page(run.parent, runs)
    write_run_tables(run.parent, runs)


def write_image(kind: str, **options):
    def made(folder: Path) -> Path:
        pixels = np.random.default_rng(0).integers(0, 255, (9, 13, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"a.{kind}", **options)
        return folder / f"a.{kind}"

    return made


def write_deep_tiff(folder: Path) -> Path:
    from tifffile import imwrite

    imwrite(folder / "a.tif", np.random.default_rng(0).integers(0, 2**16, (9, 13, 3), np.uint16), photometric="rgb")
    return folder / "a.tif"


def read_image(path: Path) -> None:
    picture = read_picture(path)
    assert picture.shape[2] == 3
    assert bool(np.isfinite(picture).all())


def part(*names: str):
    return lambda folder: write_run(folder).joinpath(*names)


KINDS = {
    "catalogue": (write_catalogue, read_catalogue),
    "text": (write_text_catalogue, read_catalogue),
    "set": (write_set, read_set),
    "weights": (write_weights, read_weights),
    "recipe": (write_recipe, read_weights),
    "table": (write_table, read_table),
    "checkpoint": (write_checkpoint, read_checkpoint),
    "metrics": (part("metrics.json"), read_run),
    "result": (part("result.json"), read_run),
    "overrides": (part(".hydra", "overrides.yaml"), read_run),
    "config": (part(".hydra", "config.yaml"), read_run),
    "curves": (part("curves", "metrics.csv"), read_run),
    "painting": (part("painting.png"), read_run),
    **{kind: (write_image(kind), read_image) for kind in ("png", "jpg", "gif", "webp", "bmp", "tif", "ppm")},
    "deep": (write_deep_tiff, read_image),
}


# How it is damaged.


def flipped(data: bytes, chance: random.Random) -> bytes:
    found = bytearray(data)
    for _ in range(chance.choice([1, 1, 2, 8])):
        found[chance.randrange(len(found))] ^= 1 << chance.randrange(8)
    return bytes(found)


def cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))]


def moved(data: bytes, chance: random.Random) -> bytes:
    """A piece is doubled, left out, or replaced."""
    first, last, place = sorted(chance.randrange(len(data)) for _ in range(3))
    new = chance.choice([data[first:last], b"", bytes(last - first), b"\xff" * 8, b"9" * 20, DEEP.encode(), b"NaN"])
    return data[:first] + new + data[chance.choice([first, last, place]) :]


def worded(data: bytes, chance: random.Random) -> bytes:
    """What YAML and JSON may hold."""
    return chance.choice([*WORDS, "", "just words", "[1, 2]", "{}", "null", '{"a": 1, "a": 2}', "a: " + DEEP]).encode()


def changed(tree, chance: random.Random):
    """One place of nested data is something else, or gone."""
    if isinstance(tree, dict | list) and tree and chance.random() < 0.85:
        tree = copy.copy(tree)
        key = chance.choice(list(tree) if isinstance(tree, dict) else range(len(tree)))
        if chance.random() < 0.1:
            del tree[key]
        else:
            tree[key] = changed(tree[key], chance)
        return tree
    if isinstance(tree, torch.Tensor) and chance.random() < 0.8:
        wrong = [tree * float("nan"), tree[..., :0], tree.expand(7, *tree.shape), tree.double(), torch.ones(1).expand(10**12)]
        return chance.choice([*wrong, tree.to("meta"), torch.sparse_coo_tensor(size=(10**9,)), tree.to(torch.complex64)])
    return chance.choice(HOSTILE)


def rewritten(path: Path, chance: random.Random) -> None:
    """The same kind of file, whole, but with other content."""
    if path.suffix == ".json":
        path.write_text(json.dumps(changed(json.loads(path.read_text()), chance)))
    elif path.suffix == ".yaml":
        tree = OmegaConf.to_container(OmegaConf.load(path))
        path.write_text(json.dumps(changed(tree, chance)))
    elif path.suffix in (".pth", ".ckpt"):
        with suppress(AttributeError, TypeError, NotImplementedError):
            buffer = BytesIO()
            torch.save(changed(torch.load(path, weights_only=True), chance), buffer)
            path.write_bytes(buffer.getvalue())
    elif path.suffix == ".h5":
        with h5py.File(path, "a") as file, suppress(TypeError, OverflowError, ValueError):
            changed_hdf5(file, chance, path)
    elif path.suffix == ".safetensors":
        tensors = {"a": torch.full((3,), torch.nan), "b": torch.ones(2, 2).to(torch.float8_e4m3fn)}
        path.write_bytes(save({key: tensors[key] for key in chance.sample(list(tensors), chance.randrange(3))}))


def changed_hdf5(file: h5py.File, chance: random.Random, path: Path) -> None:
    name = chance.choice(list(file))
    if chance.random() < 0.5:
        name, value = chance.choice(list(file.attrs)), chance.choice(HOSTILE)
        file.attrs[name] = fixed(value) if isinstance(value, str) and chance.random() < 0.8 else value
        return
    old = file[name]
    shape, dtype, unit, held = old.shape, old.dtype, fixed("x"), old[()]
    del file[name]
    claims = (10**8, *shape[1:])
    packed = {"chunks": (min(16, shape[0]), *shape[1:]), "compression": "gzip", "shuffle": True, "fletcher32": True}
    way = chance.randrange(9)
    if way == 0:
        file.create_dataset(name, shape=claims, dtype=dtype, maxshape=(None, *shape[1:]), **packed)
    elif way == 1:
        file.create_dataset(name, shape=shape, dtype=dtype, external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)])
    elif way == 2:
        file[name] = h5py.ExternalLink(str(path.parent / "pipe"), "/x")
        return
    elif way == 3:
        file[name] = h5py.SoftLink("/" + name)
        return
    elif way == 4:
        layout = h5py.VirtualLayout(shape=shape, dtype=dtype)
        layout[...] = h5py.VirtualSource(str(path.parent / "other.h5"), name, shape=shape)
        file.create_virtual_dataset(name, layout)
    elif way == 5:
        file.create_dataset(name, data=held, compression="lzf", chunks=packed["chunks"])
    elif way == 6:
        file.create_dataset(name, data=chance.choice([held[:0], held.astype("f8"), held.tobytes(), np.full(shape, 250, dtype)]))
    elif way == 7:
        file.create_dataset(name, data=np.full(shape, np.nan if dtype.kind == "f" else 1, dtype), maxshape=(None, *shape[1:]), **packed)
    else:
        file.create_group(name)
    file[name].attrs["unit"] = unit


BYTES = {"flipped": flipped, "cut": cut, "moved": moved, "worded": worded}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """One good file of a kind."""
    known = {}

    def make(kind: str) -> tuple[Path, bytes]:
        if kind not in known:
            path = KINDS[kind][0](tmp_path_factory.mktemp(kind))
            known[kind] = path, path.read_bytes()
        return known[kind]

    return make


@pytest.fixture(autouse=True)
def composed(config, monkeypatch):
    if not SETTINGS:
        SETTINGS.update(settings_of(config))
    hydra = OmegaConf.create({"overrides": {"task": []}})
    monkeypatch.setattr(fitting, "HydraConfig", SimpleNamespace(get=lambda: hydra))


def attempt(kind: str, path: Path) -> None:
    """Read a file: to its end, or to a refusal of one line."""
    global watching
    watching = True
    events.clear()
    try:
        KINDS[kind][1](path)
    except UserError as error:
        assert "\n" not in str(error), error
        assert len(str(error)) < 1000 + 5 * len(str(path)), str(error)[:300]
    finally:
        watching = False
    assert not events, events
    assert not Path("ran").exists()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("way", [*BYTES, "rewritten"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_to_finite_content_or_refused_in_one_line(kind, way, made):
    path, whole = made(kind)
    attempt(kind, path)  # it was good
    for seed in range(CASES):
        chance = random.Random(f"{kind} {way} {seed}")
        path.write_bytes(whole)
        if way == "rewritten":
            rewritten(path, chance)
        else:
            path.write_bytes(BYTES[way](whole, chance))
        try:
            attempt(kind, path)
        except BaseException:
            print(f"seed {seed}")
            raise
        finally:
            path.write_bytes(whole)
