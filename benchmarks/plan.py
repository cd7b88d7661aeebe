"""Compare plans that use a table of mixtures and brushes from the start with paintings converted to it afterwards.

    python benchmarks/plan.py        (a minute for each picture and number of mixtures, on one core)

Each picture is painted twice with the same numbers of strokes and steps: with `tubes=`, and with look=even, whose
strokes are then converted to the same mixtures and brushes. The converted strokes are played back in the order of the
plan and in their own order, and the better result is reported. Both plans are played back with brushes that run dry.
The table has the median CIEDE2000 differences of four pictures from the target: the target with each pixel replaced by
its nearest mixture (pixels), the painting with look=even before (plain) and after conversion (afterwards), and the plan
(planned). The last column compares the plan with the photograph before its tones are mapped to the range of the paints.
Means are geometric, with two standard errors.
"""

import argparse
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from brushexp_changes.tubes.difference import median_difference
from brushexp_changes.tubes.mixtures import all_mixtures, map_tones
from brushexp_changes.tubes.paints import load_tubes
from brushexp_changes.tubes.plan import plan_of
from brushexp_changes.tubes.table import Table
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from brushexp.api.settings import settings_of
from brushexp.painting.build import target_of
from brushexp.painting.changes import build_changes
from brushexp.plugins.export.base import ExportJob
from brushexp.tasks.paint import paint_picture

THESIS12 = Path(__file__).parents[1] / "src/brushexp/conf/pictures/thesis12.yaml"
QUIET = {"frames": 0, "report": False, "logger": []}


def render_job(job: ExportJob) -> Tensor:
    """Render a painting as a tensor (3, H, W) in [0, 1]."""
    return torch.from_numpy(job.picture()).movedim(2, 0) / 255


def best_pixels(target: Tensor, table: Table) -> Tensor:
    """Replace the colour of each pixel by the perceptually nearest mixture."""
    colors, which = np.unique((255 * target.flatten(1).T).round().byte().numpy(), axis=0, return_inverse=True)
    nearest = torch.cat([table.mixture_of(part) for part in (torch.from_numpy(colors) / 255).split(4096)])
    return table.mixtures.color[nearest[torch.from_numpy(which)]].T.reshape(target.shape)


def paint_plain(cfg: DictConfig, strokes: int, target: Tensor) -> ExportJob:
    """Paint a target with look=even, a given number of strokes and the steps in ``cfg``."""
    same = {"strokes": strokes, "steps": cfg.steps, "resolution": cfg.resolution, "threads": cfg.threads}
    free = settings_of("paint", {"image": target.movedim(0, 2).numpy(), "look": "even", **same, **QUIET})
    with free.as_asked():
        return paint_picture(free.cfg).job


def compare(image: str, options: dict[str, object], counts: list[int]) -> Iterator[dict[str, object]]:
    """For each number of mixtures, paint a picture with the table and without it; yield differences from the target."""
    plain = None
    for count in counts:
        constrained = settings_of("paint", {"image": image, "tubes": "eight", "mixtures": count, **options, **QUIET})
        cfg, tubes = constrained.cfg, build_changes(constrained.cfg)["tubes"]
        picture, candidates = target_of(cfg), all_mixtures(load_tubes(tubes.tubes))
        target = map_tones(picture, candidates)
        table, scale = tubes.table_for(target, candidates), target.shape[2] / (10 * tubes.width_cm)
        with constrained.as_asked():
            planned = paint_picture(cfg).job
        plain = plain or paint_plain(cfg, len(planned.strokes), target)
        plan, afterwards = plan_of(planned, table, scale), plan_of(plain, table, scale)
        played, own = render_job(plan.play_back()), replace(afterwards, order=plain.bottom_up)
        row = {
            "pixels": median_difference(best_pixels(target, table), target),
            "plain": median_difference(render_job(plain), target),
            "afterwards": min(median_difference(render_job(each.play_back()), target) for each in (afterwards, own)),
            "planned": median_difference(played, target),
            "photograph": median_difference(played, picture),
        }
        yield {"picture": image, "mixtures": count} | row | {"ratio": row["planned"] / row["afterwards"]}


def main() -> None:
    """Print a row for each picture and number of mixtures, and the geometric mean of the ratios with its interval."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", nargs="+", default=[])
    parser.add_argument("--mixtures", nargs="+", type=int, default=[24, 96])
    parser.add_argument("--set", nargs="*", default=[], help="keys in addition to tubes=: resolution=512 width_cm=30")
    arguments = parser.parse_args()
    logging.getLogger("brushexp").setLevel(logging.WARNING)
    options = {"resolution": 320, **OmegaConf.to_container(OmegaConf.from_dotlist(arguments.set))}
    rows: list[dict[str, object]] = []
    for image in arguments.pictures or OmegaConf.load(THESIS12):
        for row in compare(image, options, arguments.mixtures):
            if not rows:
                print("|", " | ".join(row), "|\n|" + "---|" * len(row))
            print(
                "|", " | ".join(f"{x:.2f}" if isinstance(x, float) else str(x) for x in row.values()), "|", flush=True
            )
            rows.append(row)
    for count in arguments.mixtures:
        logs = np.log([row["ratio"] for row in rows if row["mixtures"] == count])
        error = logs.std(ddof=1) / len(logs) ** 0.5 if len(logs) > 1 else np.nan
        low, middle, high = np.exp(logs.mean() + 2 * error * np.array([-1, 0, 1]))
        met = int((logs <= np.log(0.5)).sum())
        print(f"{count} mixtures: ratio {middle:.2f} ({low:.2f} to {high:.2f}), at most a half in {met} of {len(logs)}")


if __name__ == "__main__":
    main()
