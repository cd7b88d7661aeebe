"""Tables of finished runs, curves over time, and measures of strokes."""

from brushexp.reporting.tables import MISSING, csv_table, escape_markdown, latex_table, markdown_table
from brushexp.results.anytime_curves import LEAD, Curve, curve_from, curves_by_image, leaders, mean_curve, mean_curves
from brushexp.results.comparisons import PageTable, RunComparison
from brushexp.results.multiple_tests import holm
from brushexp.results.painting_files import read_painting
from brushexp.results.provenance import remark_on_provenance
from brushexp.results.quantities import Quantity, digits, quantities
from brushexp.results.runs import (
    JOBS,
    differences,
    gather,
    has_ended,
    image_name,
    make_unique,
    objective_in,
    read_result,
    setting_of,
    shorten,
    words_of,
)
from brushexp.results.stroke_table import (
    DIRECTION_BINS,
    MEASURES,
    RADIUS_PITCHES,
    SIZE_MEASURES,
    Array,
    StrokeTable,
    direction_shares,
    measure_strokes,
    sizes_set_by,
)
from brushexp.results.tables import is_album, numbers, over_seeds, run_count, varying_settings, write_run_tables

__all__ = [
    "DIRECTION_BINS",
    "JOBS",
    "LEAD",
    "MEASURES",
    "MISSING",
    "RADIUS_PITCHES",
    "SIZE_MEASURES",
    "Array",
    "Curve",
    "PageTable",
    "Quantity",
    "RunComparison",
    "StrokeTable",
    "csv_table",
    "curve_from",
    "curves_by_image",
    "differences",
    "digits",
    "direction_shares",
    "escape_markdown",
    "gather",
    "has_ended",
    "holm",
    "image_name",
    "is_album",
    "latex_table",
    "leaders",
    "make_unique",
    "markdown_table",
    "mean_curve",
    "mean_curves",
    "measure_strokes",
    "numbers",
    "objective_in",
    "over_seeds",
    "quantities",
    "read_painting",
    "read_result",
    "remark_on_provenance",
    "run_count",
    "setting_of",
    "shorten",
    "sizes_set_by",
    "varying_settings",
    "words_of",
    "write_run_tables",
]
