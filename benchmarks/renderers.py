"""Renderers on two fronts: how many strokes a second they draw, and how near these are to simulated strokes.

    brushexp task=evaluate renderer=neural data=data/brushes other_data=true n=2500 output=judged/neural
    python benchmarks/renderers.py FRONT.png judged/*

Folders are runs of task=evaluate on a calm machine, one after another, and their names are the labels. Prints a table,
and draws the Frechet distance of the sets of strokes, and the bristle energy of thick strokes, over the speed. On the
front is who has none beside that is as fast and as near to the truth; of energy, too much is as wrong as too little.
"""

import sys
from pathlib import Path

import numpy as np
from brushexp_studies import plotting
from brushexp_studies.pareto import front

from brushexp.reporting.tables import markdown_table
from brushexp.results.quantities import quantities
from brushexp.results.runs import gather

SHOWN = ["l2", "psnr_alpha", "psnr_color", "bristles_thick", "bristles_thin", "light_thick", "fid_effl0"]
SHOWN += ["strokes_per_second", "strokes_per_second_backward", "parameters", "file_mb"]
MISSES = {  # on an axis of this name, how far from perfect: of a share, the ratio by which it is too large or too small
    "fid_effl0": ("FID (effl0), lower is better", lambda distance: distance),
    "bristles_thick": ("share of the true bristle energy, thick strokes", lambda share: np.abs(np.log(share))),
}
BESIDE = ((6, 4), (6, -12))  # points from a dot to its label: above and below in turn, for neighbours


def main(picture: Path, folders: list[Path]) -> None:
    """Print the table of all runs, and draw their fronts."""
    metrics = gather(folders, Path())["metric"].reindex(columns=SHOWN).astype(float)
    metrics.insert(0, "renderer", [folder.name for folder in folders])
    print(markdown_table(metrics, {name: metric.digits for name, metric in quantities().items()}))
    metrics = metrics.sort_values("strokes_per_second")
    speed, figure = metrics["strokes_per_second"], plotting.new_figure()
    for axes, (name, (title, miss)) in zip(figure.subplots(1, 2), MISSES.items(), strict=True):
        plotting.tidy(axes)
        leads = front(np.stack([-speed, miss(metrics[name])], 1))
        for k, (label, x, y) in enumerate(zip(metrics["renderer"], speed, metrics[name], strict=True)):
            axes.plot(x, y, "o", color=plotting.COLORS[0] if leads[k] else plotting.GREY)
            axes.annotate(label, (x, y), xytext=BESIDE[k % 2], textcoords="offset points", fontsize=9)
        plotting.fit_scale(axes, "x", speed)
        plotting.fit_scale(axes, "y", metrics[name])
        axes.set(xlabel="strokes a second, forward", ylabel=title)
        axes.margins(x=0.25, y=0.1)
    plotting.save_figure(figure, picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sorted(map(Path, sys.argv[2:])))
