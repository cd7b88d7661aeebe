"""Measure the time spent outside the steps, for a second picture and for a folder of pictures in one process.

    python benchmarks/overhead.py second              brushexp.paint at 512 px, after a first call
    python benchmarks/overhead.py folder photos/      brushexp photos/, compared with one call per picture
    python benchmarks/overhead.py folder photos/ --count 4 quality=draft jobs=2

Times are minima over several alternating rounds; arguments with = are settings. CPU seconds include all threads.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import brushexp

# isort: split
from brushexp.pictures.folders import pictures_in

LOOKS = ("plain", "oil")
STEPS = 5


def second(rounds: int, words: list[str]) -> None:
    """Print, for each look, the seconds that a call after the first spends outside its steps."""
    options = dict(word.split("=", 1) for word in words)
    least = {look: float("inf") for look in LOOKS}
    for number in range(rounds + 1):
        for look in LOOKS:
            since = time.perf_counter()
            painting = brushexp.paint("astronaut", look=look, resolution=512, steps=STEPS, **options)
            spent = time.perf_counter() - since
            if number:
                least[look] = min(least[look], spent - painting.metrics["seconds"])
    print(f"seconds beyond {STEPS} steps, 512 px, least of {rounds}\n\n| look | seconds |\n|---|---|")
    for look, seconds in least.items():
        print(f"| {look} | {seconds:.2f} |")


def time_program(words: list[str]) -> tuple[float, float]:
    """Return the wall and CPU seconds of one run of the program."""
    since, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "brushexp", *words], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - since, cpu


def folder(place: str, count: int, rounds: int, words: list[str]) -> None:
    """Print a table of the seconds needed to paint pictures one by one and as a folder, with their ratio."""
    pictures = [Path(name).resolve() for name in pictures_in(place)[:count]]
    singly = [word for word in words if not word.startswith("jobs=")]
    least = {"one by one": (float("inf"), float("inf")), "the folder": (float("inf"), float("inf"))}
    with tempfile.TemporaryDirectory() as scratch:
        photos = Path(scratch) / "photos"
        photos.mkdir()
        for path in pictures:
            os.symlink(path, photos / path.name)
        for _ in range(rounds):
            alone = [time_program([f"image={path}", f"output={scratch}/{path.stem}", *singly]) for path in pictures]
            found = {"one by one": tuple(map(sum, zip(*alone, strict=True)))}
            found["the folder"] = time_program([f"image={photos}", f"output={scratch}/all", *words])
            least = {way: tuple(map(min, zip(least[way], found[way], strict=True))) for way in least}
            for path in Path(scratch).iterdir():
                if path != photos:
                    shutil.rmtree(path)
    print(f"{len(pictures)} pictures, {' '.join(words)}, least of {rounds}\n\n| | wall s | CPU s |\n|---|---|---|")
    for way, (wall, cpu) in least.items():
        print(f"| {way} | {wall:.1f} | {cpu:.1f} |")
    wall, cpu = (some / others for some, others in zip(least["the folder"], least["one by one"], strict=True))
    print(f"| ratio | {wall:.2f} | {cpu:.2f} |")


def main() -> None:
    """Parse the command line, and print the Markdown table of the chosen benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["second", "folder"])
    parser.add_argument("place", nargs="?", help="folder of pictures")
    parser.add_argument("--count", type=int, default=10, help="pictures")
    parser.add_argument("--rounds", type=int, default=None)
    options, words = parser.parse_known_args()
    if options.place and "=" in options.place:
        options.place, words = None, [options.place, *words]
    if options.what == "second":
        second(options.rounds or 5, words)
    else:
        folder(options.place or parser.error("folder needs a folder"), options.count, options.rounds or 1, words)


if __name__ == "__main__":
    main()
