"""Measure the time, file size, memory and fidelity of exports.

    python benchmarks/outputs.py                      (about three minutes on two idle cores)
    python benchmarks/outputs.py --strokes 2621 --resolution 4096
    python benchmarks/outputs.py --looks oil ink      (only the fidelity of SVG and replay in these looks)
    python benchmarks/outputs.py --runs outputs/a     (the same for existing paintings)
    python benchmarks/outputs.py --replay outputs/a   (only how smoothly this run's page replays)

The default picture is painted twice, once with default settings and once at 1000 px with 10,000 strokes, and then
exported. Each export runs in a separate process; its time and memory include the imports. Pages are opened in headless
Chromium. PSNR compares painting.png with the SVG, as rendered by resvg and by Chromium, and with the last frame of the
page's replay.
"""

import argparse
import base64
import io
import math
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from pictures import ROOT
from PIL import Image

PLAY = """async () => {
    const stage = document.querySelector("#replay-stage");
    document.querySelector("#play").click();
    const begin = performance.now(), frames = [begin];
    await new Promise(done => {
        const next = (now) => { frames.push(now); stage.dataset.busy === "false" && stage.dataset.playing === "false"
            && frames.length > 30 ? done() : requestAnimationFrame(next); };
        requestAnimationFrame(next);
    });
    const between = frames.slice(2).map((now, i) => now - frames[i + 1]).sort((a, b) => a - b);
    const seconds = (frames.at(-1) - begin) / 1000;
    return [between.length / seconds, between[Math.floor(0.95 * between.length)], between.at(-1), seconds];
}"""


def program(*overrides: str) -> tuple[float, float]:
    """Run run.py, and return its duration in seconds and the peak memory of its process in MB."""
    meter = (
        "import resource, subprocess, sys; "
        "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode; "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024); sys.exit(code)"
    )
    begin = time.perf_counter()
    command = [sys.executable, "-c", meter, sys.executable, str(ROOT / "run.py"), *overrides]
    memory = float(subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout)
    return time.perf_counter() - begin, memory


def export_as(catalogue: Path, folder: Path, form: str, *overrides: str) -> Path:
    """Export a painting in one format, print a row of the table, and return the folder of the export."""
    seconds, memory = program(
        "task=export", f"catalogue={catalogue}", f"to=[{form}]", f"output={folder / form}", *overrides
    )
    size = sum(path.stat().st_size for path in (folder / form).iterdir() if path.is_file() and path.name != "run.log")
    print(f"| `to={form}` {' '.join(overrides)} | {seconds:.1f} | {size / 1e6:.2f} | {memory:.0f} |", flush=True)
    return folder / form


def psnr(drawn: bytes, painting: Path) -> float:
    """Compute the PSNR between a painting's PNG and an encoded picture, which is scaled to the size of the PNG."""
    ours = Image.open(painting).convert("RGB")
    theirs = Image.open(io.BytesIO(drawn)).convert("RGB").resize(ours.size)
    return -10 * math.log10(((np.asarray(theirs, float) - np.asarray(ours, float)) ** 2).mean() / 255**2)


@contextmanager
def chromium() -> Iterator[Any]:
    """Start headless Chromium without colour management."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    with sync_playwright() as playwright:
        options = ["--no-sandbox", "--disable-gpu", "--force-color-profile=srgb"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        yield browser
        browser.close()


def last_replay_frame(browser: Any, run: Path) -> bytes:
    """Return the last frame of the replay on a run's page, as an encoded picture."""
    width, height = Image.open(run / "painting.png").size
    tab = browser.new_page(viewport={"width": 1440, "height": round(1560 * height / width)}, reduced_motion="reduce")
    tab.goto((run / "report.html").as_uri())
    tab.evaluate("document.querySelector('#replay').scrollIntoView({behavior: 'instant'})")
    tab.wait_for_selector("#replay-stage[data-live=yes][data-busy=false]", timeout=120_000)
    address = tab.evaluate("document.querySelector('.replay-paint').toDataURL()")
    return base64.b64decode(address.partition(",")[2])


def paint_look(look: str, folder: Path) -> Path:
    """Paint the default picture in a look, and return the folder of the run."""
    program(f"look={look}", "frames=0", f"output={folder / look}")
    return folder / look


def vectors(runs: Iterable[Path]) -> None:
    """Print a table of the fidelity of each run's SVG and replay."""
    import resvg_py  # noqa: PLC0415

    print(
        "| run | SVG in resvg, dB | SVG in Chromium, dB | replay, dB | SVG, MB | page, MB |\n|---|---|---|---|---|---|"
    )
    for run in runs:
        painting, svg = run / "painting.png", run / "strokes.svg"
        by_resvg = bytes(resvg_py.svg_to_bytes(svg_path=str(svg)))
        with chromium() as browser:
            width, height = Image.open(painting).size
            tab = browser.new_page(viewport={"width": width, "height": height})
            tab.goto(svg.as_uri())
            found = [psnr(drawn, painting) for drawn in (by_resvg, tab.screenshot(), last_replay_frame(browser, run))]
        sizes = [path.stat().st_size / 1e6 for path in (svg, run / "report.html")]
        print(f"| `{run.name}` |", " | ".join(f"{value:.1f}" for value in [*found, *sizes]), "|", flush=True)


def page(run: Path) -> None:
    """Print the times to write and to open a run's page, and how smoothly the page replays the painting."""
    from brushexp_studio.view import read_painting  # noqa: PLC0415

    from brushexp.config.publish import prepare  # noqa: PLC0415
    from brushexp.pages.run_page import write_run_page  # noqa: PLC0415
    from brushexp.painting.reopen import export_job  # noqa: PLC0415
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415

    prepare(ROOT)
    finished = read_painting(run, export_job(load_catalogue(run / "catalogue.h5")))
    write_run_page(run, finished)  # compiles and loads all code
    begin = time.perf_counter()
    path = write_run_page(run, finished)
    print(f"\nreport.html: written in {time.perf_counter() - begin:.2f} s, {path.stat().st_size / 1e6:.2f} MB")
    with chromium() as browser:
        tab = browser.new_page(viewport={"width": 1440, "height": 900})
        begin = time.perf_counter()
        tab.goto(path.as_uri())
        tab.wait_for_selector("#replay-stage[data-busy=false]", timeout=120_000)
        opened, (rate, late, latest, seconds) = time.perf_counter() - begin, tab.evaluate(PLAY)
    print(f"opened and drawn in {opened:.2f} s, replayed in {seconds:.1f} s (planned: 20) at {rate:.0f} frames/s; time")
    print(f"between frames: 95 % at most {late:.0f} ms, all at most {latest:.0f} ms")


def main() -> None:
    """Measure the exports, and print the results as Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--strokes", type=int, default=10_000, help="strokes of the larger painting")
    parser.add_argument("--resolution", type=int, default=8192, help="pixels on the longer side of the largest exports")
    parser.add_argument("--looks", nargs="+", help="measure only the faithfulness of SVG and replay in these looks")
    parser.add_argument("--runs", nargs="+", type=Path, help="the same for these runs, which must have a page")
    parser.add_argument("--replay", type=Path, help="measure only how smoothly the page of this run replays")
    options = parser.parse_args()
    if options.replay:
        page(options.replay)
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if options.looks or options.runs:
            vectors([*(options.runs or ()), *(paint_look(look, folder) for look in options.looks or ())])
            return
        program("look=even", "report=false", f"output={folder / 'default'}")
        program(
            "look=even",
            "steps=100",
            "resolution=1000",
            f"strokes={options.strokes}",
            "frames=0",
            f"output={folder / 'many'}",
        )
        catalogue = folder / "default" / "catalogue.h5"
        print("| export of the default painting | seconds | MB | memory MB |\n|---|---|---|---|")
        for form in ("svg", "json", "csv", "gcode", "hpgl", "process", "relief"):
            export_as(catalogue, folder, form)
        export_as(catalogue, folder, "png", f"resolution={options.resolution}")
        export_as(catalogue, folder / "large", "relief", f"resolution={options.resolution}")
        seconds, memory = program("task=analyse", f"catalogue={catalogue}", f"output={folder / 'analysis'}")
        print(f"| `task=analyse` | {seconds:.1f} | | {memory:.0f} |")
        page(folder / "many")


if __name__ == "__main__":
    main()
