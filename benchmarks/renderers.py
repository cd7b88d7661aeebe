"""Compare renderers by speed, in strokes per second, and by the similarity of their strokes to simulated strokes.

    brushexp task=evaluate renderer=neural data=data/brushes other_data=true n=2500 output=judged/neural
    python benchmarks/renderers.py FRONT.png judged/*

The folders are runs of task=evaluate, made one after another on an idle machine; their names are the labels. The script
prints a table, and plots the Frechet distance between the sets of strokes and the bristle energy of thick strokes
against speed. A renderer is on the front if no other renderer is both as fast and as accurate; too much energy counts
as an error just as too little does.
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
MISSES = {  # error measure of each quantity, with the label of its axis; a share is wrong by its ratio to 1, either way
    "fid_effl0": ("FID (effl0), lower is better", lambda distance: distance),
    "bristles_thick": ("share of the true bristle energy, thick strokes", lambda share: np.abs(np.log(share))),
}
BESIDE = ((6, 4), (6, -12))  # points from a dot to its label, alternately above and below


def main(picture: Path, folders: list[Path]) -> None:
    """Print a table of all runs, and plot the Pareto fronts of FID and of bristle energy against speed."""
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
        axes.set(xlabel="strokes per second, forward", ylabel=title)
        axes.margins(x=0.25, y=0.1)
    plotting.save_figure(figure, picture)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sorted(map(Path, sys.argv[2:])))
