"""Define the config keys of ``task=departures``, ``task=leaderboard`` and ``task=verdicts``."""

from dataclasses import dataclass

from omegaconf import MISSING

from brushexp.contracts import FILE, FOLDER, at_least, one_of
from brushexp.contracts.tasks import Task, key

RUNS = "folder of a run or sweep, or a folder of several; separate folders with commas"


@dataclass
class DeparturesTask(Task):
    """List all settings in which finished paintings depart from the thesis's procedure."""

    is_research = True
    module = "brushexp_thesis.departures"

    runs: list[str] = key(MISSING, RUNS, FOLDER)


@dataclass
class VerdictsTask(Task):
    """Judge the thesis's claims by finished studies, and write one page of verdicts, tables and plots."""

    is_research = True
    module = "brushexp_thesis.verdicts"

    runs: list[str] = key(
        MISSING, "folder of sweeps of experiment=, or of their records; separate folders with commas", FOLDER
    )
    claims: str | None = key(None, "YAML file of claims; null = the shipped claims of the thesis", FILE)
    paintings: str | None = key(None, "YAML list of pictures that are paintings; null = the shipped list", FILE)
    page: str | None = key(
        None, "Markdown file to write, with plots and records beside it; null = ablations.md in output"
    )


@dataclass
class LeaderboardTask(Task):
    """Compare finished runs, other people's paintings and published figures by their means with intervals."""

    is_research = True
    module = "brushexp_thesis.leaderboard"

    runs: list[str] = key([], RUNS, FOLDER)
    add: str | None = key(None, "painting by others: a picture, a catalogue, or a folder of these; null = none")
    target: str | None = key(None, "picture painted by add; if add is a folder, a folder with files of the same names")
    name: str | None = key(None, "name of the painter of add; null = the file's name")
    strokes: int | None = key(
        None, "number of strokes of add; null = from its catalogue, or unknown", at_least(1, typical=1000)
    )
    seconds: float | None = key(None, "seconds that add took; null = unknown", at_least(0, typical=60))
    note: str | None = key(
        None, "remark at the top of the page and tables, such as the machine and its load; null = none"
    )
    published: str | None = key(None, "YAML file of published figures; null = the shipped file", FILE)
    lpips_backbone: str = key("alexnet", "network of lpips_weights", one_of("alexnet", "squeeze", "vgg16", "effl0"))
    lpips_weights: str | None = key(
        None, "file with the features of lpips_backbone; with it, add is also measured by LPIPS", FILE
    )
