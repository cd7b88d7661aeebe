"""Measure the wall time, PSNR, SSIM and number of strokes of whole runs, started as a user would start them.

    python benchmarks/pictures.py                        the default picture
    python benchmarks/pictures.py a.jpg b.png --strokes 10000 --override quality=fine

Each picture is painted in a separate process, with look=plain unless another look is given, after an untimed run that
compiles the kernels.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]


def run(overrides: list[str], folder: Path) -> dict[str, float]:
    """Paint once, and return the contents of metrics.json with the wall time of the process added as ``wall``."""
    start = time.perf_counter()
    look = [] if any(word.startswith("look=") for word in overrides) else ["look=plain"]
    command = [sys.executable, str(ROOT / "run.py"), f"output={folder}", *look, *overrides]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall = time.perf_counter() - start
    return json.loads((folder / "metrics.json").read_text()) | {"wall": wall}


def main() -> None:
    """Paint the pictures, and print their metrics as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="*", default=["astronaut"], help="files, or samples of scikit-image")
    parser.add_argument("--strokes", type=int, help="number of strokes; one per 100 pixels by default")
    parser.add_argument("--keep", type=Path, help="folder to keep the runs in")
    parser.add_argument("--override", action="append", default=[], help="another key=value for run.py; may be repeated")
    options = parser.parse_args()
    overrides = options.override + ([f"strokes={options.strokes}"] if options.strokes else [])
    print(
        "| picture | strokes | PSNR dB | SSIM | L1 | perceptual (effl0) | optimisation s | everything s | memory MB |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        run(["resolution=64", "steps=2"], Path(scratch) / "first")
        folder = options.keep or Path(scratch)
        for picture in options.pictures:
            m = run([f"image={picture}", *overrides], folder / Path(picture).stem)
            print(
                f"| {Path(picture).stem} | {m['n_strokes']:,} | {m['psnr']:.2f} | {m['ssim']:.3f} | {m['l1']:.4f} "
                f"| {m['perceptual']:.3f} | {m['seconds']:.1f} | {m['wall']:.1f} | {m['peak_memory_mb']:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
