"""Plans under the constraints of a table against a palette that is put on afterwards, on pictures that packages ship.

    python benchmarks/plan.py --pictures astronaut chelsea coffee        (minutes for each picture)

Each picture is painted twice with as many strokes and steps: with `tubes=`, and as look=plain paints it, whose colours
and widths are then those of the same mixtures and brushes. Of the latter the better of two is taken: strokes in the
order of the plan, or in their own. Both are played back, with brushes that run dry. Told is the median CIEDE2000
from the target, that of the best painting with these mixtures, pixel by pixel, and of the painting by look=plain.
"""

import argparse
import logging
from dataclasses import replace

import numpy as np
import torch
from brushexp_tubes.difference import median_difference
from brushexp_tubes.mixtures import all_mixtures
from brushexp_tubes.paints import load_tubes
from brushexp_tubes.plan import Plan, plan_of
from brushexp_tubes.table import Table
from brushexp_tubes.task import build_constrained, table_for, within_tones
from omegaconf import OmegaConf
from torch import Tensor

from brushexp.api.settings import settings_of
from brushexp.painting.build import build_painter, target_of
from brushexp.plugins.export.base import ExportJob
from brushexp.tasks.paint import paint_picture

PAINTED, PLAIN = "tubes", "paint"
QUIET = {"frames": 0, "report": False, "logger": []}


def shown(job: ExportJob) -> Tensor:
    """Paint a picture (3, H, W)."""
    return torch.from_numpy(job.picture()).movedim(2, 0) / 255


def best_pixels(target: Tensor, table: Table) -> Tensor:
    """Give each pixel the mixture that is nearest to the eye."""
    colors, which = np.unique((255 * target.flatten(1).T).round().byte().numpy(), axis=0, return_inverse=True)
    nearest = torch.cat([table.mixture_of(part) for part in (torch.from_numpy(colors) / 255).split(4096)])
    return table.mixtures.color[nearest[torch.from_numpy(which)]].T.reshape(target.shape)


def compare(image: str, options: dict[str, object]) -> dict[str, float]:
    """Paint a picture both ways, and measure by how much each differs from the target."""
    constrained = settings_of(PAINTED, {"image": image, **options, **QUIET})
    cfg = constrained.cfg
    picture, candidates = target_of(cfg), all_mixtures(load_tubes(cfg.tubes))
    target = within_tones(picture, candidates)
    table, scale = table_for(cfg, target, candidates), target.shape[2] / (10 * cfg.width_cm)
    with constrained.as_asked():
        planned = paint_picture(cfg, build=build_constrained).job
    same = {"strokes": len(planned.strokes), "steps": cfg.steps, "resolution": cfg.resolution}
    free = settings_of(PLAIN, {"image": image, "look": "plain", **same, "threads": cfg.threads, **QUIET})
    with free.as_asked():
        plain = paint_picture(free.cfg, build=lambda cfg: build_painter(cfg, target)).job
    plan, afterwards = plan_of(planned, table, scale), plan_of(plain, table, scale)
    own = replace(afterwards, order=plain.bottom_up)
    played = shown(plan.played())
    return {
        "best pixels": median_difference(best_pixels(target, table), target),
        "plain": median_difference(shown(plain), target),
        "afterwards": min(median_difference(shown(each.played()), target) for each in (afterwards, own)),
        "planned": median_difference(played, target),
        "planned, from the photograph": median_difference(played, picture),
    }


def main() -> None:
    """Print a row for each picture, and the geometric mean of the ratios with an interval."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", nargs="+", default=[])
    parser.add_argument("--set", nargs="*", default=[], help="keys of task=tubes: mixtures=48 resolution=512")
    arguments = parser.parse_args()
    logging.getLogger("brushexp").setLevel(logging.WARNING)
    options = OmegaConf.to_container(OmegaConf.from_dotlist(arguments.set))
    images = arguments.pictures or OmegaConf.load("src/brushexp/conf/pictures/thesis12.yaml")
    ratios = []
    for image in images:
        row = compare(image, {"resolution": 512, **options})
        if not ratios:
            print("| picture |", " | ".join(row), "| ratio |\n|---|" + "---|" * (len(row) + 1))
        ratios.append(row["planned"] / row["afterwards"])
        print(f"| {image} |", " | ".join(f"{value:.2f}" for value in row.values()), f"| {ratios[-1]:.2f} |", flush=True)
    logs = np.log(ratios)
    spread = 2 * logs.std(ddof=1) / len(logs) ** 0.5 if len(logs) > 1 else np.nan
    low, middle, high = np.exp([logs.mean() - spread, logs.mean(), logs.mean() + spread])
    print(f"\nratio {middle:.3f} ({low:.3f} to {high:.3f}; two standard errors), below one half: {np.mean(np.array(ratios) <= 0.5):.0%}")


if __name__ == "__main__":
    main()
