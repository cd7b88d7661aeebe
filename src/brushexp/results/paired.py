"""Paired differences: how much better a setting is than another one on the same pictures, or with the same seeds.

What is paired is the unit: the picture if several were painted, else the seed. Of each unit the difference between the
means of its runs counts once, so that what differs between units, and it differs most, does not blur the comparison.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from typing import TYPE_CHECKING, Any

import numpy as np

from brushexp.reporting import plotting
from brushexp.reporting.plotting import COLORS, GREY, INK
from brushexp.reporting.tables import csv_table, markdown_table
from brushexp.results.quantities import Quantity, quantities
from brushexp.results.runs import differences
from brushexp.results.tables import numbers
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

CONFIDENCE = 0.95
LEAST_UNITS = 3  # for an interval that a verdict may rest on
LEAST_ODD = 3  # pictures each way from which on an answer depends on the picture
NOT_DECIDED = "not decided"
PICTURE, SEED = "picture", "seed"
RULE = (
    "An interval is that of Student's t over the {units} at {confidence:.0%} for all comparisons of a study with its "
    "reference together (Bonferroni). In this order: a difference {depends}is *better* or *worse* if the "
    "interval excludes zero; there is *no difference larger than* what the interval allows, if that does not matter; "
    "else it is *not decided*, as it is with fewer than {least} {units}."
)
DEPENDS = (  # of pictures only
    "*depends on the picture* if at least {odd} of them differ by more than what matters, where that is known, in each "
    "direction; it "
)

# Panels of the plot: as many as have room, of these and then of the other metrics.
PANELS = ("psnr", "psnr_alpha", "ssim", "edges", "perceptual", "fid_effl0", "cpu_seconds")
MOST_PANELS = 4
ROW, TALLEST = 0.16, 30.0  # inches: of a letter, of a figure
LETTERS = ascii_uppercase + ascii_lowercase
LARGEST_LOGARITHM = 700.0  # whose number is one: exp(710) is none
LABEL = 28  # letters in a line of a label


@dataclass(frozen=True)
class Difference:
    """A setting against a reference in one metric, of the units that have both.

    ``gains`` by unit, ``mean``, ``low`` and ``high`` are positive where the setting is better; for metrics that are
    compared as ratios (`Metric.ratio`) they are natural logarithms of them. ``unit`` is "picture" or "seed".
    """

    option: str
    reference: str
    metric: str
    unit: str
    gains: dict[str, float]
    mean: float
    low: float
    high: float

    @property
    def quantity(self) -> Quantity:
        """What the metric is."""
        return quantities()[self.metric]

    @property
    def better(self) -> list[str]:
        """The units on which the setting is better by more than what matters."""
        return [unit for unit, gain in self.gains.items() if gain > self.quantity.matters]

    @property
    def worse(self) -> list[str]:
        """Those on which it is worse by more."""
        return [unit for unit, gain in self.gains.items() if gain < -self.quantity.matters]

    @property
    def verdict(self) -> str:
        """One of ``depends``, ``better``, ``worse``, ``same`` and ``not decided``, by `RULE`."""
        if len(self.gains) < LEAST_UNITS or not math.isfinite(self.low):
            return NOT_DECIDED
        matters = self.quantity.matters
        if self.unit == PICTURE and matters and min(len(self.better), len(self.worse)) >= LEAST_ODD:
            return "depends"
        if self.low > 0 or self.high < 0:
            return "better" if self.low > 0 else "worse"
        return "same" if max(-self.low, self.high) <= matters else NOT_DECIDED

    @property
    def is_no_worse(self) -> bool:
        """Whether the interval allows no loss that matters, and the answer does not depend on the picture."""
        allows_none = self.low >= -self.quantity.matters
        return len(self.gains) >= LEAST_UNITS and allows_none and self.verdict != "depends"

    @property
    def bounds(self) -> str:
        """The interval, in the metric's own direction."""
        ends = (self.low, self.high) if self.quantity.better == "higher" else (self.high, self.low)
        return f"[{', '.join(map(self.shown, ends))}]"

    @property
    def sentence(self) -> str:
        """The verdict in words, with its numbers."""
        found = f"{self.shown(self.mean)} {self.bounds}"
        if self.verdict == "same":
            metric, most = self.quantity, max(abs(self.low), abs(self.high))
            largest = times(most) if metric.ratio else f"{most:.{metric.digits}f}"
            return f"no difference larger than {largest}"
        if self.verdict == "depends":
            some = f"better on {', '.join(self.better)}; worse on {', '.join(self.worse)}"
            return f"depends on the picture: {some}; {found} on average"
        if self.verdict == NOT_DECIDED and len(self.gains) < LEAST_UNITS:
            return f"{NOT_DECIDED}, {len(self.gains)} {self.unit}{'s' * (len(self.gains) != 1)}"
        return f"{self.verdict}: {found}"

    def shown(self, gain: float) -> str:
        """A gain in the metric's own direction: ``+0.31``, or ``x 1.50`` for ratios."""
        metric = self.quantity
        change = gain if metric.better == "higher" else -gain
        if metric.ratio:
            return times(change)
        return f"{change:+.{metric.digits}f}"


def times(logarithm: float) -> str:
    """A ratio to three digits, of its natural logarithm: ``x 1.00``."""
    return f"x {math.exp(logarithm) if logarithm < LARGEST_LOGARITHM else math.inf:#.3g}".removesuffix(".")


def interval(values: Iterable[float], confidence: float = CONFIDENCE) -> tuple[float, float, float]:
    """Mean of a sample and the bounds of its interval by Student's t; infinite ones for a single value."""
    from scipy.stats import t  # noqa: PLC0415

    found = np.array(list(values), float)
    if len(found) < 2:
        return float(found.mean()), -math.inf, math.inf
    half = float(t.ppf((1 + confidence) / 2, len(found) - 1) * found.std(ddof=1) / math.sqrt(len(found)))
    return float(found.mean()), float(found.mean()) - half, float(found.mean()) + half


def paired_table(frame: DataFrame) -> DataFrame | None:
    """The metrics of finished runs by setting and unit; None if there are no two settings, or no two units.

    Columns are metrics; the index has levels "option", the overrides in which runs differ but for image and seed, in
    the order of the sweep, and "picture" or "seed".
    """
    compared = frame[frame["run", "label"].notna()]
    if compared.empty:
        return None
    typed = [{k: v for k, v in one.items() if k not in ("image", "seed")} for one in compared["run", "overrides"]]
    options = np.array([" ".join(parts) or "default" for parts in differences(typed)], object)
    pictures = compared["run", "image"].str.replace(r", \d+ x \d+ pixels", "", regex=True)
    if compared["run", "target"].groupby([options, pictures]).nunique().max() > 1:
        pictures = compared["run", "image"]  # several of one name, which their sizes tell apart
    unit = PICTURE if pictures.nunique() > 1 and (pictures != "").all() else SEED
    by_unit = pictures if unit == PICTURE else compared["setting", SEED]
    units = by_unit.fillna("0").astype(str).to_numpy()
    if len(set(options)) < 2 or len(set(units)) < 2:
        return None
    return numbers(compared).groupby([options, units], sort=False).mean().rename_axis(["option", unit])


def paired_differences(
    table: DataFrame | None,
    reference: str | None = None,
    metrics: Sequence[str] = (),
    comparisons: int | None = None,
) -> list[Difference]:
    """All settings of a `paired_table` against one, the first if none is named, in those metrics that have a better.

    Intervals are right for so many ``comparisons`` together (Bonferroni); by default, those with the reference.
    """
    if table is None:
        return []
    options, units = (list(dict.fromkeys(table.index.get_level_values(level))) for level in (0, 1))
    reference = options[0] if reference is None else reference
    confidence = 1 - (1 - CONFIDENCE) / max(1, len(options) - 1 if comparisons is None else comparisons)
    wanted = metrics or [key for key in table if quantities()[key].better]
    found = []
    for metric in wanted:
        by_unit = table[metric].unstack(level=0).reindex(units) if metric in table else None
        for option in options:
            if option != reference and by_unit is not None:
                gains = gains_of(by_unit[option], by_unit[reference], metric)
                if gains:
                    low_high = interval(gains.values(), confidence)
                    found.append(Difference(option, reference, metric, str(table.index.names[1]), gains, *low_high))
    return found


def gains_of(values: Any, others: Any, metric: str) -> dict[str, float]:
    """By how much values are better than others, by unit, where both are known; see `Difference`."""
    both = values.notna() & others.notna()
    if quantities()[metric].ratio:
        both &= (values > 0) & (others > 0)
        values, others = np.log(values[both]), np.log(others[both])
    sign = 1 if quantities()[metric].better == "higher" else -1
    return {str(unit): float(gain) for unit, gain in (sign * (values[both] - others[both])).items()}


def difference_rows(found: Sequence[Difference]) -> list[dict[str, Any]]:
    """A row per setting and metric, in words."""
    return [
        {
            "setting": one.option,
            "against": one.reference,
            "metric": one.quantity.name,
            "difference": one.shown(one.mean),
            "interval": one.bounds,
            "better on": f"{sum(gain > 0 for gain in one.gains.values())} of {len(one.gains)}",
            "verdict": one.sentence,
        }
        for one in found
    ]


def rule_for(unit: str) -> str:
    """`RULE` in words for pictures or seeds."""
    depends = DEPENDS.format(odd=LEAST_ODD) if unit == PICTURE else ""
    return RULE.format(units=f"{unit}s", confidence=CONFIDENCE, depends=depends, least=LEAST_UNITS)


def told_of(found: Sequence[Difference]) -> str:
    """What differences are against, what is paired, and the rule of their verdicts; Markdown."""
    return f"Against `{found[0].reference}`, paired by {found[0].unit}. {rule_for(found[0].unit)}"


def write_differences(folder: Path, frame: DataFrame) -> list[Difference]:
    """Write ``differences.md``, ``.csv`` and ``.png`` of runs with several settings on the same units; else nothing."""
    found = paired_differences(paired_table(frame))
    if not found:
        return []
    text = markdown_table(
        [{k: v for k, v in row.items() if k != "against"} for row in difference_rows(found)], align="llrlrl"
    )
    write_text(folder / "differences.md", f"{told_of(found)}\n\n{text}\n")
    every = [
        {"setting": one.option, "against": one.reference, "metric": one.metric, one.unit: name, "gain": gain}
        for one in found
        for name, gain in one.gains.items()
    ]
    write_text(folder / "differences.csv", csv_table(every))
    write_paired_plot(folder / "differences.png", found, folder.resolve().name)
    return found


def write_paired_plot(path: Path, found: Sequence[Difference], title: str) -> Path:
    """Write a PNG with a panel per metric; a bar is the mean with its interval."""
    compared = {one.metric for one in found}
    metrics = [key for key in dict.fromkeys([*PANELS, *quantities()]) if key in compared][:MOST_PANELS]
    shown = [one for one in found if one.metric in metrics]
    options = list(dict.fromkeys(one.option for one in shown))
    units = list(dict.fromkeys(unit for one in shown for unit in one.gains))
    figure = plotting.new_figure(min(TALLEST, 2.2 + max(0.6, ROW * (len(units) + 1)) * len(options)))
    panels = figure.subplots(1, len(metrics), squeeze=False, sharey=True)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        plotting.tidy(axes)
        _panel(axes, {one.option: one for one in shown if one.metric == metric}, options, units)
        quantity = quantities()[metric]
        axes.set_xlabel(f"{quantity.name}\n{'natural log of the ratio, ' * quantity.ratio}better to the right")
    panels[0].set_yticks(range(len(options)), [plotting.label_lines(option, LABEL) for option in options])
    panels[0].set_ylim(len(options) - 0.5, -0.5)
    reference = plotting.without_math(found[0].reference)
    plotting.entitle(
        figure, path.parent / title, f"against {reference}; letters are {found[0].unit}s, bars their mean and interval"
    )
    names = "   ".join(f"{letter} {plotting.without_math(unit)}" for letter, unit in zip(LETTERS, units, strict=False))
    figure.supxlabel(plotting.folded(names, 150, most=6), fontsize=9, color=INK)
    return plotting.save_figure(figure, path)


def _panel(axes: Axes, rows: dict[str, Difference], options: Sequence[str], units: Sequence[str]) -> None:
    axes.axvline(0, color=GREY, linewidth=1)
    axes.locator_params(axis="x", nbins=4)
    heights = 0.8 * (np.arange(len(units)) + 0.5) / len(units) - 0.4
    for row, option in enumerate(options):
        if option not in rows:
            continue
        one = rows[option]
        if np.isfinite(one.low):
            axes.fill_betweenx([row - 0.42, row + 0.42], one.low, one.high, color=COLORS[0], alpha=0.16, linewidth=0)
        axes.plot([one.mean, one.mean], [row - 0.42, row + 0.42], color=COLORS[0], linewidth=1.6)
        for k, unit in enumerate(units):
            if unit in one.gains:
                letter = LETTERS[k % len(LETTERS)]
                axes.plot(
                    one.gains[unit], row + heights[k], marker=rf"$\mathrm{{{letter}}}$", color=INK, markersize=5.5
                )
