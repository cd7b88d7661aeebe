"""Compare settings by paired differences, over pictures or, if there is only one picture, over seeds.

Each unit (a picture or a seed) contributes one difference, between the means of its runs.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from pandas import DataFrame

from brushexp.contracts.files import write_text
from brushexp.contracts.results import (
    Quantity,
    csv_table,
    differences,
    escape_markdown,
    markdown_table,
    numbers,
    quantities,
    remark_on_provenance,
)
from brushexp_studies import plotting
from brushexp_studies.plotting import COLORS, GREY, INK, TALLEST

CONFIDENCE = 0.95
LEAST_UNITS = 3  # minimum number of units for a verdict
LEAST_ODD, LEAST_SHARE = 3, 0.2  # minimum number and share of pictures each way for "depends on the picture"
NOT_DECIDED = "not decided"
PICTURE, SEED = "picture", "seed"
PANELS = ("psnr", "psnr_alpha", "ssim", "edges", "perceptual", "fid_effl0", "cpu_seconds")  # first metrics in the plot
MOST_PANELS = 4
LETTER_HEIGHT = 0.16  # height in inches of a unit's letter in the plot
LETTERS = ascii_uppercase + ascii_lowercase
LARGEST_LOGARITHM = 700.0  # upper bound on logarithms of ratios; exp(710) overflows


@dataclass(frozen=True)
class Difference:
    """Gains of a setting over a reference in one metric, for every unit (picture or seed) that was run with both.

    ``gains`` maps each unit to its gain. The gains, ``mean``, ``low`` and ``high`` are positive where the setting is
    better; in metrics compared by ratio, they are natural logarithms.
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
        """The description of the metric: its name, direction and smallest difference that matters."""
        return quantities()[self.metric]

    def units_that_gain(self, sign: int) -> list[str]:
        """List the units on which the setting is better (``sign`` 1) or worse (-1) by an amount that matters."""
        return [unit for unit, gain in self.gains.items() if sign * gain > self.quantity.matters]

    @property
    def verdict(self) -> str:
        """The verdict: ``depends``, ``same``, ``better``, ``worse`` or ``not decided``; see `rule_for`."""
        if len(self.gains) < LEAST_UNITS or not math.isfinite(self.low):
            return NOT_DECIDED
        matters = self.quantity.matters
        smaller = min(len(self.units_that_gain(1)), len(self.units_that_gain(-1)))
        if self.unit == PICTURE and matters and smaller >= max(LEAST_ODD, LEAST_SHARE * len(self.gains)):
            return "depends"
        if max(-self.low, self.high) <= matters:
            return "same"
        if self.low > 0 or self.high < 0:
            return "better" if self.low > 0 else "worse"
        return NOT_DECIDED

    @property
    def is_no_worse(self) -> bool:
        """Whether the interval excludes a loss that matters, and the verdict is not ``depends``."""
        allows_none = self.low >= -self.quantity.matters
        return len(self.gains) >= LEAST_UNITS and allows_none and self.verdict != "depends"

    @property
    def bounds(self) -> str:
        """The confidence interval as text, expressed as a change in the metric."""
        ends = (self.low, self.high) if self.quantity.better == "higher" else (self.high, self.low)
        return f"[{', '.join(map(self.format_gain, ends))}]"

    @property
    def effect(self) -> str:
        """The mean and its confidence interval as text, expressed as a change in the metric."""
        return f"{self.format_gain(self.mean)} {self.bounds}"

    @property
    def sentence(self) -> str:
        """The verdict in words, with the figures behind it."""
        if self.verdict == "same":
            return f"no difference that matters: {self.effect}"
        if self.verdict == "depends":
            better, worse = (", ".join(self.units_that_gain(sign)) for sign in (1, -1))
            return f"depends on the picture: better on {better}; worse on {worse}; {self.effect} on average"
        if self.verdict == NOT_DECIDED and len(self.gains) < LEAST_UNITS:
            return f"{NOT_DECIDED}, {len(self.gains)} {self.unit}{'s' * (len(self.gains) != 1)}"
        return f"{self.verdict}: {self.effect}"

    def format_gain(self, gain: float) -> str:
        """Format a gain as a change in the metric itself: ``+0.31``, or ``x 1.50`` for ratios."""
        change = gain if self.quantity.better == "higher" else -gain
        return format_ratio(change) if self.quantity.ratio else f"{change:+.{self.quantity.digits}f}"


def format_ratio(logarithm: float) -> str:
    """Format a ratio, given its natural logarithm, with three significant digits: ``x 1.00``."""
    return f"x {math.exp(logarithm) if logarithm < LARGEST_LOGARITHM else math.inf:#.3g}".removesuffix(".")


def interval(values: Iterable[float], confidence: float = CONFIDENCE) -> tuple[float, float, float]:
    """Compute the mean of a sample and its Student's t interval; a single value has infinite bounds."""
    from scipy.stats import t  # noqa: PLC0415

    sample = np.array(list(values), float)
    mean = float(sample.mean())
    if len(sample) < 2:
        return mean, -math.inf, math.inf
    half = float(t.ppf((1 + confidence) / 2, len(sample) - 1) * sample.std(ddof=1) / math.sqrt(len(sample)))
    return mean, mean - half, mean + half


def paired_table(frame: DataFrame) -> DataFrame | None:
    """Tabulate the metrics of finished runs by setting and unit; return None for fewer than two settings or units.

    The columns are metrics. The index has two levels: "option", which holds the overrides in which the runs differ
    apart from image and seed, and "picture" or "seed".
    """
    compared = frame[frame["run", "label"].notna()]
    if compared.empty:
        return None
    typed = [{k: v for k, v in one.items() if k not in ("image", "seed")} for one in compared["run", "overrides"]]
    options = np.array([" ".join(parts) or "default" for parts in differences(typed)], object)
    pictures = compared["run", "image"].str.replace(r", \d+ x \d+ pixels", "", regex=True)
    if compared["run", "target"].groupby([options, pictures]).nunique().max() > 1:
        pictures = compared["run", "image"]  # pictures of one name that differ in size
    unit = PICTURE if pictures.nunique() > 1 and (pictures != "").all() else SEED
    by_unit = pictures if unit == PICTURE else compared["setting", SEED]
    units = by_unit.fillna("0").astype(str).to_numpy()
    if len(set(options)) < 2 or len(set(units)) < 2:
        return None
    return numbers(compared).groupby([options, units], sort=False).mean().rename_axis(["option", unit])


def paired_differences(
    table: DataFrame | None, reference: str | None = None, metrics: Sequence[str] = (), comparisons: int | None = None
) -> list[Difference]:
    """Compare all settings of a `paired_table` with a reference, by default the first setting.

    If ``metrics`` is empty, the comparison covers all metrics for which it is known whether higher or lower is better.
    The intervals are corrected for ``comparisons`` simultaneous comparisons (Bonferroni), by default one for each
    setting compared.
    """
    if table is None:
        return []
    options, units = (list(dict.fromkeys(table.index.get_level_values(level))) for level in (0, 1))
    reference = options[0] if reference is None else reference
    confidence = 1 - (1 - CONFIDENCE) / max(1, len(options) - 1 if comparisons is None else comparisons)
    unit, result = str(table.index.names[1]), []
    for metric in metrics or [key for key in table if quantities()[key].better]:
        by_unit = table[metric].unstack(level=0).reindex(units) if metric in table else table.iloc[:0]
        for option in options:
            if option != reference and option in by_unit:
                gains = gains_of(by_unit[option], by_unit[reference], metric)
                if gains:
                    mean_low_high = interval(gains.values(), confidence)
                    result.append(Difference(option, reference, metric, unit, gains, *mean_low_high))
    return result


def gains_of(values: Any, others: Any, metric: str) -> dict[str, float]:
    """Compute the gain of ``values`` over ``others`` for each unit; positive gains are better (see `Difference`)."""
    both = values.notna() & others.notna()
    if quantities()[metric].ratio:
        both &= (values > 0) & (others > 0)
        values, others = np.log(values[both]), np.log(others[both])
    sign = 1 if quantities()[metric].better == "higher" else -1
    return {str(unit): float(gain) for unit, gain in (sign * (values[both] - others[both])).items()}


def difference_rows(differences: Sequence[Difference]) -> list[dict[str, Any]]:
    """Return one table row, with values formatted as text, for each setting and metric."""
    return [
        {
            "setting": one.option,
            "metric": one.quantity.name,
            "difference": one.format_gain(one.mean),
            "interval": one.bounds,
            "better on": f"{sum(gain > 0 for gain in one.gains.values())} of {len(one.gains)}",
            "verdict": one.sentence,
        }
        for one in differences
    ]


def rule_for(unit: str) -> str:
    """State in words the rule that decides a verdict, for differences over pictures or over seeds."""
    depends = (
        f"a difference *depends on the picture* if, in each direction, at least {LEAST_ODD} pictures and "
        f"{LEAST_SHARE:.0%} of them differ by more than what matters, where that is known; "
    ) * (unit == PICTURE)
    return (
        f"Intervals are Student's t over the {unit}s, at {CONFIDENCE:.0%} jointly for all comparisons of a study with "
        f"its reference (Bonferroni). The first rule that applies decides: {depends}there is *no difference that "
        "matters* if the interval allows none; a setting is *better* or *worse* if the interval "
        f"excludes zero; otherwise, and with fewer than {LEAST_UNITS} {unit}s, it is *not decided*."
    )


def explain_pairing(differences: Sequence[Difference]) -> str:
    """State, in Markdown, the reference, the unit of pairing and the rule that decides a verdict."""
    unit = differences[0].unit
    return f"Against `{differences[0].reference}`, paired by {unit}. {rule_for(unit)}"


def write_differences(folder: Path, frame: DataFrame) -> list[Difference]:
    """Write ``differences.md``, ``.csv`` and ``.png`` if several settings were run on the same units."""
    differences = paired_differences(paired_table(frame))
    if not differences:
        return []
    table = markdown_table(difference_rows(differences), align="llrlrl")
    parts = [explain_pairing(differences), escape_markdown(remark_on_provenance(frame)), table]
    write_text(folder / "differences.md", "\n\n".join(filter(None, parts)) + "\n")
    every = [
        {"setting": one.option, "against": one.reference, "metric": one.metric, one.unit: name, "gain": gain}
        for one in differences
        for name, gain in one.gains.items()
    ]
    write_text(folder / "differences.csv", csv_table(every))
    write_paired_plot(folder / "differences.png", differences, folder.resolve().name)
    return differences


def write_paired_plot(path: Path, differences: Sequence[Difference], title: str) -> Path:
    """Write a PNG with one panel per metric, in which bars show means with their confidence intervals."""
    measured = {one.metric for one in differences}
    metrics = [key for key in dict.fromkeys([*PANELS, *quantities()]) if key in measured][:MOST_PANELS]
    shown = [one for one in differences if one.metric in metrics]
    options = list(dict.fromkeys(one.option for one in shown))
    units = list(dict.fromkeys(unit for one in shown for unit in one.gains))
    row = max(0.6, LETTER_HEIGHT * (len(units) + 1))
    figure = plotting.new_figure(min(TALLEST, 2.2 + row * len(options)))
    panels = figure.subplots(1, len(metrics), squeeze=False, sharey=True)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        _panel(axes, {one.option: one for one in shown if one.metric == metric}, options, units)
        quantity = quantities()[metric]
        axes.set_xlabel(f"{quantity.name}\n{'natural log of the ratio, ' * quantity.ratio}better to the right")
    against = f"against {plotting.without_math(differences[0].reference)}"
    unit = differences[0].unit
    plotting.add_title(figure, path.parent / title, f"{against}; letters are {unit}s, bars their mean and interval")
    names = "   ".join(f"{letter} {plotting.without_math(unit)}" for letter, unit in zip(LETTERS, units, strict=False))
    figure.supxlabel(plotting.wrap_text(names, 150, most=6), fontsize=9, color=INK)
    return plotting.save_figure(figure, path)


def _panel(axes: Axes, rows: dict[str, Difference], options: Sequence[str], units: Sequence[str]) -> None:
    plotting.tidy(axes)
    axes.axvline(0, color=GREY, linewidth=1)
    axes.locator_params(axis="x", nbins=4)
    for row, one in ((row, rows[option]) for row, option in enumerate(options) if option in rows):
        if np.isfinite(one.low):
            axes.fill_betweenx([row - 0.42, row + 0.42], one.low, one.high, color=COLORS[0], alpha=0.16, linewidth=0)
        axes.vlines(one.mean, row - 0.42, row + 0.42, color=COLORS[0], linewidth=1.6)
    gains = DataFrame([rows[option].gains if option in rows else {} for option in options], options, units, float)
    markers = (rf"$\mathrm{{{LETTERS[k % len(LETTERS)]}}}$" for k in range(len(units)))
    plotting.draw_strips(axes, gains, [{"marker": marker, "color": INK, "markersize": 5.5} for marker in markers])
