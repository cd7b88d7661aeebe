"""Runs: their folders, the Trainer, resuming and sweeps; also the Python functions of ``brushexp``."""

from brushexp.api.painting import Painting
from brushexp.api.parts import create, render
from brushexp.api.settings import settings_of, undisturbed
from brushexp.registry.loading import load_plugins
from brushexp.runs.closing import how_to_go_on
from brushexp.runs.provenance import provenance_of
from brushexp.runs.resume import RECORD_KEY, RunRecord, record_of, restore_run
from brushexp.runs.run_folder import note_words, release_folder, take_folder
from brushexp.runs.runner import perform
from brushexp.runs.sweep_jobs import begin_sweep, check_jobs
from brushexp.runs.sweep_report import renew_sweep_report
from brushexp.runs.tracking import make_trackers
from brushexp.runs.trainer import conclude, fit, make_trainer
from brushexp.system.status import UNFINISHED, Status

__all__ = [
    "RECORD_KEY",
    "UNFINISHED",
    "Painting",
    "RunRecord",
    "Status",
    "begin_sweep",
    "check_jobs",
    "conclude",
    "create",
    "fit",
    "how_to_go_on",
    "load_plugins",
    "make_trackers",
    "make_trainer",
    "note_words",
    "perform",
    "provenance_of",
    "record_of",
    "release_folder",
    "render",
    "renew_sweep_report",
    "restore_run",
    "settings_of",
    "take_folder",
    "undisturbed",
]
