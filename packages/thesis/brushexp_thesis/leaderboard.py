"""``task=leaderboard``: painters beside each other, of finished runs, of others, and figures that were published."""

import logging
import shlex
from pathlib import Path
from textwrap import shorten

from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.results.runs import gather, words_of
from brushexp_thesis.added import add_paintings
from brushexp_thesis.leaderboard_page import write_leaderboard_page, write_standings_plot
from brushexp_thesis.published import SHIPPED_FIGURES, read_published
from brushexp_thesis.standings import entries_of, sections_of
from brushexp_thesis.standings_tables import write_leaderboard_tables

log = logging.getLogger(__name__)
NOT_SHOWN = ("output", "overwrite", "note")  # words of the command


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write page and tables of the runs in ``cfg.runs`` and of what is added."""
    published = read_published(Path(cfg.published) if cfg.published else SHIPPED_FIGURES)
    folders = [Path(path) for path in cfg.runs]
    if cfg.add is not None:
        name, numbers = cfg.name or Path(cfg.add).stem, {"n_strokes": cfg.strokes, "seconds": cfg.seconds}
        add_paintings(folder / "added", Path(cfg.add), cfg.target, name, numbers, cfg.lpips_backbone, cfg.lpips_weights)
        folders.append(folder / "added")
    if not folders:
        raise UserError("nothing is given; try runs=outputs, or add=painting.png target=photo.jpg name=theirs")
    runs = gather(folders, folder)
    entries = entries_of(runs)
    if not entries:
        raise UserError(f"runs={','.join(cfg.runs)}: there is no finished painting; give folders of such with runs=")
    others = sorted({str(path) for path in runs["run"]["folder"]} - {str(entry.folder) for entry in entries})
    if others:
        log.warning("left out, for these are no finished paintings: %s", shorten(", ".join(others), 300))
    sections = sections_of(entries, published)
    beside = {id(one) for section in sections for one in section.published}
    elsewhere = [one for one in published if id(one) not in beside]
    words = [word for word in words_of(folder) if word.partition("=")[0] not in NOT_SHOWN]
    write_standings_plot(folder, sections)
    write_leaderboard_page(folder, sections, elsewhere, cfg.note or "")
    command = shlex.join(["brushexp", *words])
    table = write_leaderboard_tables(folder, sections, elsewhere, command, cfg.note or "")
    log.info("%s: %d paintings in %d sections", table, len(entries), len(sections))
    return {"paintings": len(entries), "status": "completed"}  # without a metrics.json: it is no run itself
