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
benchmarks, the script first writes the record. Intervals are over paintings, drawn again within each family.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

LOOKS = ("clean", "hard")
ROWS = {"trained without the family": "unseen", "trained with it": "seen", "gain": "gain", "shipped weights": "shipped"}
DRAWS, LEVEL = 4000, 0.95  # of the bootstrap


def read_benchmark(folder: Path, weights: str) -> pd.DataFrame:
    """Read the F1 of each painting from the folder of a benchmark."""
    rows = pd.read_csv(folder / "figures.csv")
    rows = rows[rows["method"] == "recovery"]
    return rows[["scene", "kind", "look", "seen", "f1"]].assign(weights=weights)


def compare(record: pd.DataFrame, look: str) -> pd.DataFrame:
    """Return the F1 of each painting in one look: unseen, seen, their difference (``gain``), and with shipped weights.

    Raises a ValueError unless each painting was unseen to one half of the weights and seen by the other.
    """
    rows = record[record["look"] == look]
    halves = rows[rows["weights"] == "half"].pivot(index=["kind", "scene"], columns="seen", values="f1")
    if halves.shape[1] != 2 or halves.isna().any(axis=None):
        raise ValueError("a painting was not seen by exactly one half of the weights")
    table = halves.rename(columns={False: "unseen", True: "seen"})
    table["gain"] = table["seen"] - table["unseen"]
    table["shipped"] = rows[rows["weights"] == "shipped"].set_index(["kind", "scene"])["f1"]
    return table


def mean_and_interval(values: pd.Series) -> tuple[float, float, float]:
    """Compute the mean and its bootstrap interval; ``values`` are indexed by (kind, scene)."""
    random = np.random.default_rng(0)
    kinds = [group.to_numpy() for _, group in values.groupby("kind")]
    draws = [random.choice(kind, (DRAWS, len(kind))).mean(1) for kind in kinds]
    low, high = np.quantile(np.mean(draws, axis=0), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(np.mean([kind.mean() for kind in kinds])), float(low), float(high)


def table_of(record: pd.DataFrame) -> list[str]:
    """Make the lines of a Markdown table."""
    tables = [compare(record, look) for look in LOOKS]
    lines = [f"| F1: {len(tables[0])} paintings | clean | hard |", "|---|---|---|"]
    for title, column in ROWS.items():
        figures = [mean_and_interval(table[column]) for table in tables]
        cells = " | ".join(f"{mean:z.2f} ({low:z.2f} to {high:z.2f})" for mean, low, high in figures)
        lines.append(f"| {title} | {cells} |")
    return lines


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
