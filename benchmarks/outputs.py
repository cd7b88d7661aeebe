"""What leaves the program: how long it takes, how large it is, how much memory it needs, and how true it is.

    python benchmarks/outputs.py                      (about three minutes on two idle cores)
    python benchmarks/outputs.py --strokes 2621 --resolution 4096

Paints the default picture twice, as it is and at 1000 px with 10,000 strokes, then exports: each in a process of its
own, imports included in seconds and memory. PSNR is of the SVG drawn by resvg against our own picture of the catalogue.
Pages are opened in headless Chromium, if Playwright and Chromium are there.
"""

import argparse
import io
import math
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from pictures import ROOT
from PIL import Image

PLAY = """async () => {
    document.querySelector("#play").click();
    const begin = performance.now();
    let count = 0;
    await new Promise(done => {
        const next = () => { count++; performance.now() - begin > 2000 ? done() : requestAnimationFrame(next); };
        requestAnimationFrame(next);
    });
    return 1000 * count / (performance.now() - begin);
}"""


def program(*overrides: str) -> tuple[float, float]:
    """Run run.py; seconds and the most memory (MB) of the process."""
    meter = (
        "import resource, subprocess, sys; "
        "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode; "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024); sys.exit(code)"
    )
    begin = time.perf_counter()
    command = [sys.executable, "-c", meter, sys.executable, str(ROOT / "run.py"), *overrides]
    memory = float(subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout)
    return time.perf_counter() - begin, memory


def exported(catalogue: Path, folder: Path, form: str, *overrides: str) -> Path:
    """Print a row of the table for one kind of export; its folder."""
    seconds, memory = program(
        "task=export", f"catalogue={catalogue}", f"to=[{form}]", f"output={folder / form}", *overrides
    )
    size = sum(path.stat().st_size for path in (folder / form).iterdir() if path.is_file() and path.name != "run.log")
    print(f"| `to={form}` {' '.join(overrides)} | {seconds:.1f} | {size / 1e6:.2f} | {memory:.0f} |", flush=True)
    return folder / form


def psnr(svg: Path, picture: Path) -> float:
    """Of an SVG drawn by resvg against a PNG."""
    import resvg_py  # noqa: PLC0415

    drawn = Image.open(io.BytesIO(bytes(resvg_py.svg_to_bytes(svg_path=str(svg))))).convert("RGB")
    ours = Image.open(picture).convert("RGB")
    return -10 * math.log10(((np.asarray(drawn, float) - np.asarray(ours, float)) ** 2).mean() / 255**2)


def page(run: Path) -> None:
    """Print how long the page of a run takes to write and to open, and how smoothly it replays."""
    from brushexp.app.command_line import prepare  # noqa: PLC0415
    from brushexp.results.page.run import write_run_page  # noqa: PLC0415

    prepare(ROOT)
    write_run_page(run)  # what is compiled or loaded once
    begin = time.perf_counter()
    path = write_run_page(run)
    print(f"\nreport.html: written in {time.perf_counter() - begin:.2f} s, {path.stat().st_size / 1e6:.2f} MB")
    chromium = shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright  # noqa: PLC0415
    except ImportError:
        return
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        tab = browser.new_page(viewport={"width": 1440, "height": 900})
        begin = time.perf_counter()
        tab.goto(path.as_uri())
        print(f"opened in {time.perf_counter() - begin:.2f} s, replayed at {tab.evaluate(PLAY):.0f} frames/s")
        browser.close()


def main() -> None:
    """Print Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--strokes", type=int, default=10_000, help="of the larger painting")
    parser.add_argument("--resolution", type=int, default=8192, help="of the largest pictures")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        program("look=plain", "report=false", f"output={folder / 'default'}")
        program(
            "look=plain",
            "steps=100",
            "resolution=1000",
            f"strokes={options.strokes}",
            "frames=0",
            f"output={folder / 'many'}",
        )
        catalogue = folder / "default" / "catalogue.h5"
        print("| export of the default painting | seconds | MB | memory MB |\n|---|---|---|---|")
        svg = exported(catalogue, folder, "svg")
        for form in ("json", "csv", "gcode", "hpgl", "process", "relief"):
            exported(catalogue, folder, form)
        exported(catalogue, folder, "png", f"resolution={options.resolution}")
        exported(catalogue, folder / "large", "relief", f"resolution={options.resolution}")
        seconds, memory = program("task=analyse", f"catalogue={catalogue}", f"output={folder / 'analysis'}")
        print(f"| `task=analyse` | {seconds:.1f} | | {memory:.0f} |")
        print(f"\nSVG by resvg: {psnr(svg / 'strokes.svg', folder / 'default' / 'painting.png'):.2f} dB")
        page(folder / "many")


if __name__ == "__main__":
    main()
