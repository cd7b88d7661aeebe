r"""Compare how well recovery finds strokes of families of paint that its training left out and that it included.

    brushexp task=train_recovery families=true 'leave_out=[dabs,hatching,scanned,washes]' minutes=26 threads=1 \
        paintings=150 output=half_a
    brushexp task=train_recovery families=true 'leave_out=[daubs,impasto,slabs,wet_in_wet]' minutes=26 threads=1 \
        paintings=150 output=half_b
    brushexp task=benchmark weights=half_a/strokes.safetensors 'methods=[recovery]' 'counts=[80]' side=256 repeats=3 \
        'kinds=[dabs,daubs,hatching,impasto,scanned,slabs,washes,wet_in_wet]' output=bench_a
    (the same with half_b, and with the shipped weights)
    python benchmarks/recovery_families.py families.csv --halves bench_a bench_b --shipped bench
    python benchmarks/recovery_families.py families.csv

Each painting is by a family that one half of the weights has seen and the other has not. Given the folders of the
benchmarks, the script first writes the record. Intervals are over paintings. For the published record, all paintings of
the trainings (``sets=``) existed before.
"""

import argparse
from pathlib import Path

import pandas as pd
from brushexp_recovery.benchmark.report_tables import interval_table

COLUMNS = ["scene", "kind", "look", "seen", "f1"]
ROWS = {"unseen": "trained without the family", "seen": "trained with it", "gain": "gain", "shipped": "shipped weights"}


def read_benchmark(folder: Path, weights: str) -> pd.DataFrame:
    """Read the F1 of each painting from the folder of a benchmark."""
    rows = pd.read_csv(folder / "figures.csv")
    return rows.loc[rows["method"] == "recovery", COLUMNS].assign(weights=weights)


def compare(record: pd.DataFrame) -> pd.DataFrame:
    """Return the F1 of each painting in each look: unseen, seen, their difference (``gain``), with shipped weights.

    Raises a ValueError unless each painting was unseen to one half of the weights and seen by the other.
    """
    painting = ["kind", "scene", "look"]
    halves = record[record["weights"] == "half"].pivot(index=painting, columns="seen", values="f1")
    if halves.shape[1] != 2 or halves.isna().any(axis=None):
        raise ValueError("a painting was not seen by exactly one half of the weights")
    table = halves.rename(columns={False: "unseen", True: "seen"})
    table["gain"] = table["seen"] - table["unseen"]
    table["shipped"] = record[record["weights"] == "shipped"].set_index(painting)["f1"]
    return table


def table_of(record: pd.DataFrame) -> list[str]:
    """Make the lines of a Markdown table of means over paintings."""
    rows = compare(record)[list(ROWS)].melt(var_name="method", value_name="f1", ignore_index=False).reset_index()
    means = [line for line in interval_table(rows.to_dict("records")) if line["kind"] == "mean of kinds"]
    head = [f"| F1: {means[0]['paintings']} paintings | clean | hard |", "|---|---|---|"]
    return head + [f"| {ROWS[line['method']]} | {line['clean']} | {line['hard']} |" for line in means]


def main() -> None:
    """Write the record if benchmarks are given, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("record", type=Path)
    parser.add_argument("--halves", type=Path, nargs=2, help="benchmarks of the weights of both halves")
    parser.add_argument("--shipped", type=Path, help="benchmark of the shipped weights")
    options = parser.parse_args()
    if options.halves:
        parts = [read_benchmark(folder, "half") for folder in options.halves]
        pd.concat([*parts, read_benchmark(options.shipped, "shipped")]).to_csv(options.record, index=False)
    print("\n".join(table_of(pd.read_csv(options.record))))


if __name__ == "__main__":
    main()
