"""Renderers on two fronts: how many strokes a second they draw, and how near these are to simulated strokes.

    brushexp task=evaluate renderer=neural data=data/brushes other_data=true n=2500 threads=1 output=judged/neural
    python benchmarks/renderers.py FRONT.png judged/*

Folders are runs of task=evaluate on a calm machine, one after another, and their names are the labels. Prints a table,
and draws the Frechet distance of the sets of strokes, and the bristle energy of thick strokes, over the speed. On the
front is who has none beside that is as fast and as near to the truth; of energy, too much is as wrong as too little.
"""

import sys
from pathlib import Path

import numpy as np

from brushexp.results import plotting
from brushexp.results.pareto import front
from brushexp.results.runs import gather
from brushexp.results.tables import METRICS, markdown_table

SHOWN = ["l2", "psnr_alpha", "psnr_color", "bristles_thick", "bristles_thin", "light_thick", "fid_effl0"]
SHOWN += ["strokes_per_second", "strokes_per_second_backward", "parameters", "file_mb"]
MISSES = {  # how far from perfect: a distance as it is, a share by the ratio that it is too large or too small by
    "fid_effl0": lambda distance: distance,
    "bristles_thick": lambda share: np.abs(np.log(np.maximum(share, 1e-9))),
}


def main(picture: Path, folders: list[Path]) -> None:
    """Print the table of all runs, and draw their fronts."""
    metrics = gather(folders, Path())["metric"].reindex(columns=SHOWN).astype(float)
    metrics.insert(0, "renderer", [folder.name for folder in folders])
    print(markdown_table(metrics, {name: metric.digits for name, metric in METRICS.items()}))
    figure = plotting.new_figure()
    for axes, (name, miss) in zip(figure.subplots(1, 2), MISSES.items(), strict=True):
        plotting.tidy(axes)
        speed, value = metrics["strokes_per_second"], metrics[name]
        best = front(np.stack([-speed, miss(value)], 1))
        for label, x, y, leads in zip(metrics["renderer"], speed, value, best, strict=True):
            axes.plot(x, y, "o", color=plotting.COLORS[0] if leads else plotting.GREY)
            axes.annotate(label, (x, y), xytext=(6, 4), textcoords="offset points", fontsize=9)
        axes.set(xscale="log", yscale="log", xlabel="strokes a second, forward", ylabel=plotting.metric_label(name))
        axes.margins(x=0.25)
    plotting.save_figure(figure, picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sorted(map(Path, sys.argv[2:])))
