"""Keys of ``task=departures``, ``task=leaderboard`` and ``task=verdicts``."""

from dataclasses import dataclass

from omegaconf import MISSING

from brushexp.contracts import FILE, FOLDER, at_least, one_of
from brushexp.contracts.tasks import Task, key

RUNS = "folder of a run, of a sweep, or above many of them; several with commas"


@dataclass
class DeparturesTask(Task):
    """List every setting in which finished paintings differ from the procedure of the thesis."""

    is_research = True
    module = "brushexp_thesis.departures"

    runs: list[str] = key(MISSING, RUNS, FOLDER)


@dataclass
class VerdictsTask(Task):
    """Judge the claims of the thesis by finished studies: one page with verdicts, tables and plots."""

    is_research = True
    module = "brushexp_thesis.verdicts"

    runs: list[str] = key(
        MISSING, "folder of sweeps of experiment=, or of records of such; several with commas", FOLDER
    )
    claims: str | None = key(None, "YAML file of claims; null = the thesis's, which ship", FILE)
    paintings: str | None = key(None, "YAML list of pictures to tell apart, as paintings; null = those that ship", FILE)
    page: str | None = key(None, "Markdown file to write, plots and records beside it; null = ablations.md in output")


@dataclass
class LeaderboardTask(Task):
    """Put painters beside each other: finished runs, paintings by others, published figures; means and intervals."""

    is_research = True
    module = "brushexp_thesis.leaderboard"

    runs: list[str] = key([], RUNS, FOLDER)
    add: str | None = key(None, "a painting by others: a picture, a catalogue, or a folder of them; null = none")
    target: str | None = key(None, "what it was painted after; of a folder, one with files of the same names")
    name: str | None = key(None, "of the painter of add; null = as the file is called")
    strokes: int | None = key(None, "that add took; null = those of a catalogue, else unknown", at_least(1))
    seconds: float | None = key(None, "that add took; null = unknown", at_least(0))
    note: str | None = key(None, "what page and tables begin with: the machine, say, and what else it did; null = none")
    published: str | None = key(None, "YAML file of published figures; null = those that ship", FILE)
    lpips_backbone: str = key("alexnet", "network of lpips_weights", one_of("alexnet", "squeeze", "vgg16", "effl0"))
    lpips_weights: str | None = key(None, "file with its features: add is then measured with LPIPS, too", FILE)
