"""Paint the sealed test set once: pictures that were not used for any design choice.

    python benchmarks/sealed.py collect unpacked/ sealed/    (unpacked/: the packages named in sealed.yaml)
    python benchmarks/sealed.py paint sealed/ outputs/sealed

`collect` copies the listed pictures from a folder and its subfolders. Before the first stroke, `paint` records the date
and the version in sealed.json; then it paints each picture with the settings in `WORDS`, and writes the metrics of each
picture to sealed.csv. If the set has been painted before, `paint` refuses to paint it again. `--again REASON` paints it
nevertheless and records the reason; from then on, the set is a development set, and reports must say so.
"""

import argparse
import hashlib
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from brushexp_thesis.study_records import studies_in

from brushexp import __version__
from brushexp.contracts.files import json_of, read_text, yaml_of
from brushexp.system.files import write_json

LIST = Path(__file__).with_suffix(".yaml")
WORDS = ("experiment=kodak24", "resolution=768", "threads=1", "logger=[]", "report=false")


def digests_in(listed: Path) -> dict[str, str]:
    """Read the file names and SHA-256 digests in a list of pictures."""
    lines = yaml_of(read_text(listed, "give a list of pictures with their SHA-256"), list)
    return {name: digest for line in lines for name, digest in line.items()}


def digest_of(path: Path) -> str:
    """Compute the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def collect(packages: Path, into: Path, listed: Path = LIST) -> None:
    """Copy the listed pictures from a folder and its subfolders; exit if any are missing."""
    digests = digests_in(listed)
    found = {path.name: path for path in packages.rglob("*") if digests.get(path.name) and path.is_file()
             and digest_of(path) == digests[path.name]}  # fmt: skip
    if missing := sorted(digests.keys() - found.keys()):
        sys.exit(f"{packages} lacks {', '.join(missing)}; unpack the packages that {listed.name} names there")
    into.mkdir(parents=True, exist_ok=True)
    for name, path in found.items():
        shutil.copyfile(path, into / name)


def paint(
    pictures: Path, output: Path, again: str = "", listed: Path = LIST, words: Sequence[str] = WORDS,
    run: Callable[[Sequence[str]], int] = subprocess.call,
) -> None:  # fmt: skip
    """Paint the listed pictures and write their metrics next to the list; exit if they have been painted before."""
    openings = listed.with_suffix(".json")
    before = json_of(read_text(openings, "")) if openings.is_file() else []
    if before and not again:
        first = before[0]
        sys.exit(
            f"{listed.name} was painted on {first['date']} by version {first['version']}, and its figures are in "
            f"{listed.stem}.csv; painting it again makes it a development set: give the reason with --again REASON"
        )
    digests = digests_in(listed)
    wrong = [name for name, digest in digests.items()
             if not (pictures / name).is_file() or digest_of(pictures / name) != digest]  # fmt: skip
    if wrong:
        sys.exit(
            f"{pictures} lacks files of {listed.name}: {', '.join(wrong)}; copy them there with `sealed.py collect`"
        )
    paths = ",".join(str(pictures.resolve() / name) for name in digests)
    typed = [*words, f"pictures=[{paths}]", f"output={output.resolve()}"]
    opening = {"date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"), "version": __version__, "words": list(words)}
    opening |= {"commit": commit_of(listed.parent), "again": again}
    write_json(openings, [*before, opening])
    if code := run([sys.executable, "-m", "brushexp", *typed]):
        sys.exit(
            f"the run ended with {code}; {openings.name} counts the set as painted, since pictures may have been seen"
        )
    (study,) = studies_in([output], output).values()
    study.record(listed.with_suffix(".csv"))


def commit_of(folder: Path) -> str:
    """Return the commit checked out in a folder, with ``-dirty`` if files differ, or "" outside a repository."""
    described = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--abbrev=40"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return described.stdout.strip()


def main() -> None:
    """Parse the command line, and collect or paint the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    collecting = commands.add_parser("collect", help="copy the pictures into one folder")
    collecting.add_argument("packages", type=Path)
    collecting.add_argument("into", type=Path)
    painting = commands.add_parser("paint", help="paint the pictures, once")
    painting.add_argument("pictures", type=Path)
    painting.add_argument("output", type=Path)
    painting.add_argument("--again", default="", metavar="REASON", help="paint a set that has been painted before")
    given = parser.parse_args()
    if given.command == "collect":
        collect(given.packages, given.into)
    else:
        paint(given.pictures, given.output, given.again)


if __name__ == "__main__":
    main()
