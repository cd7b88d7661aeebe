"""Measure the PSNR of decoded paintings against bits per stroke, for files of a given size.

    python benchmarks/byte_goal.py docs/records/byte_goal.csv

Three scikit-image photographs are painted with `look=plain`. A file without strokes needs 60 bytes; the rest of the
file size, divided by a given number of bits per stroke, determines the maximum number of strokes. The strokes are
rounded as finely as the size allows. The number of bits per stroke that `bits=` assumes (`brushexp_coding.goal`) was
chosen from this table.
"""

import csv
import sys
from pathlib import Path

import brushexp

PHOTOGRAPHS = ("astronaut", "coffee", "chelsea")
SIZES = ((128, 800), (128, 2000), (192, 6000))  # side in pixels, bytes
BITS = (65, 75, 85, 95, 110, 130)  # per stroke
OVERHEAD = 60  # bytes
COLUMNS = ("photograph", "side", "size", "bits_a_stroke", "strokes", "bytes", "psnr", "psnr_decoded")


def row_of(name, side, size, bits):
    """Paint a photograph with as many strokes as fit at ``bits`` bits each, and return its row of the table."""
    painting = brushexp.paint(
        name,
        look="plain",
        resolution=side,
        density="worth_bytes",
        max_strokes=int((size - OVERHEAD) * 8 / bits),
        metric=["psnr", "bits"],
        threads=1,
        **{"metric.bits.size": f"{size}B"},
    )
    metrics = painting.metrics
    quality = (f"{metrics[key]:.2f}" for key in ("psnr", "psnr_decoded"))
    return name, side, size, bits, metrics["n_strokes"], metrics["bytes"], *quality


def main():
    """Write the table to the file named on the command line."""
    with Path(sys.argv[1]).open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for name in PHOTOGRAPHS:
            for side, size in SIZES:
                for bits in BITS:
                    table.writerow(row_of(name, side, size, bits))
                    file.flush()


if __name__ == "__main__":
    main()
