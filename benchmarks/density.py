"""Strokes where the picture needs them: density=adaptive against density=fixed, whole runs of the program.

    python benchmarks/density.py                       samples of scikit-image
    python benchmarks/density.py a.png b.jpg           other pictures

For each picture: as many strokes and steps for both; and with how few strokes adaptive is as good as fixed. Runs of one
picture follow each other, so that their seconds can be compared; each is a process of its own.
"""

import argparse
import tempfile
from pathlib import Path

from pictures import run


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="*", default=["astronaut", "coffee", "chelsea"], help="files, or samples")
    parser.add_argument("--strokes", type=int, default=10_000, help="how many")
    parser.add_argument("--fewer", type=float, default=0.6, help="share of the strokes in the last run")
    parser.add_argument("--steps", type=int, default=1500, help="of the last run; the others have the default")
    options = parser.parse_args()
    few = round(options.fewer * options.strokes)
    rows = {
        "fixed": [f"strokes={options.strokes}"],
        "adaptive": [f"strokes={options.strokes}", "density=adaptive"],
        "fewer": [f"strokes={few}", "density=adaptive", f"steps={options.steps}"],
    }
    print("| picture | density | strokes | steps | PSNR dB | to fixed | SSIM | perceptual | seconds | times fixed |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    gains: dict[str, list[float]] = {name: [] for name in rows}
    ratios: dict[str, list[float]] = {name: [] for name in rows}
    with tempfile.TemporaryDirectory() as scratch:
        run(["resolution=64", "steps=20", "density=adaptive"], Path(scratch) / "first")
        for picture in options.pictures:
            fixed = None
            for name, overrides in rows.items():
                m = run([f"image={picture}", "frames=0", *overrides], Path(scratch) / Path(picture).stem / name)
                fixed = fixed or m
                gains[name].append(m["psnr"] - fixed["psnr"])
                ratios[name].append(m["seconds"] / fixed["seconds"])
                print(
                    f"| {Path(picture).stem} | {name} | {m['n_strokes']:,} | {m['steps']} | {m['psnr']:.2f} "
                    f"| {gains[name][-1]:+.2f} | {m['ssim']:.3f} | {m['perceptual']:.3f} | {m['seconds']:.1f} "
                    f"| {ratios[name][-1]:.2f} |",
                    flush=True,
                )
    for name in list(rows)[1:]:
        n = len(options.pictures)
        print(f"\n{name}: {sum(gains[name]) / n:+.2f} dB in {sum(ratios[name]) / n:.2f} times the seconds, on average")


if __name__ == "__main__":
    main()
