"""How well a run's time is predicted: whole runs of the program, predicted against measured seconds of optimisation.

    python benchmarks/prediction.py                 all cases (about five minutes on two idle cores)
    python benchmarks/prediction.py default 768     some of them

Each case is a process of its own, in which a prediction is made however short the run; a first, uncounted run compiles
the kernels. The goal is a ratio between 0.7 and 1.3; the machine should have nothing else to do.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
CASES = {
    "default": ["resolution=512"],
    "768": ["image=coffee", "resolution=768", "strokes=10000"],
    "textured": ["resolution=512", "renderer=textured"],
    "perceptual": ["resolution=512", "loss=perceptual", "steps=100"],
    "patches": ["resolution=512", "sampler=patches", "steps=1500"],
    "1024": ["image=retina", "resolution=1024"],
    "neural": ["resolution=256", "renderer=neural", "steps=200", "finish_steps=5"],
}
# The program, but every run is long enough for a prediction.
PROGRAM = """
import runpy, sys
from brushexp.painting import cost
cost.predict.__kwdefaults__["long"] = 0.0
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def run(overrides: list[str], folder: Path) -> dict[str, float]:
    """Paint once and return metrics.json."""
    command = [sys.executable, "-c", PROGRAM, str(ROOT / "run.py"), f"output={folder}", *overrides]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    found: dict[str, float] = json.loads((folder / "metrics.json").read_text())
    return found


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", help=f"{', '.join(CASES)}; left out: all")
    parser.add_argument("--override", action="append", default=[], help="more of run.py's key=value, for every case")
    options = parser.parse_args()
    print("| case | strokes | steps | predicted s | measured s | predicted / measured |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for name in options.cases or CASES:
            first = [*CASES[name], *options.override, "resolution=64", "steps=2", "strokes=20", "frames=0"]
            run(first, Path(scratch) / f"first_{name}")
            m = run([*CASES[name], *options.override], Path(scratch) / name)
            ratio = m["predicted_seconds"] / m["seconds"]
            print(
                f"| {name} | {m['n_strokes']:,} | {m['steps']:,} | {m['predicted_seconds']:.1f} | {m['seconds']:.1f} "
                f"| {ratio:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
