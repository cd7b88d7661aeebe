"""Compare the rate and distortion of coded strokes and image codecs: PSNR of decoded pictures against bits per pixel.

    python benchmarks/rate.py paint records.csv --kodak ../shared/images/kodak   # paint, code, and add to the records
    python benchmarks/rate.py show records.csv figure.png                        # print the tables, and draw the figure

The pictures are icons drawn by this script, scikit-image photographs, and some of Kodak's pictures from a folder, all
reduced in size. Each is painted with several numbers of strokes, which are coded; Pillow writes JPEG, WebP, AVIF and
JPEG 2000 files at many quality settings. Rates count whole files. Pictures that are already in the records are skipped.
Bjontegaard's rate difference (2001) is the mean difference in log rate over the range of PSNR that two curves share;
curves are monotone cubics here. Confidence intervals come from 2,000 bootstrap samples of the pictures in a set.
"""

import argparse
import csv
import io
from collections import defaultdict
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw
from scipy.interpolate import PchipInterpolator
from skimage import data

SIDE = 192  # pixels on the longer side
KODAK = ("kodim05", "kodim08", "kodim15", "kodim23")
PHOTOGRAPHS = ("astronaut", "chelsea", "coffee")
STROKES = (40, 160, 640)
LOSS = 0.5  # PSNR in dB that rounding may cost
STEPS = 200
RATES = (0.1, 0.25, 0.5, 1.0, 2.0)  # bits per pixel in the table
SUPERSAMPLING = 4
SAMPLES = 2_000  # bootstrap samples
FIELDS = ("set", "picture", "width", "height", "codec", "setting", "bits_per_pixel", "psnr")
LAYERS = (0.06, 0.1, 0.16, 0.25, 0.4, 0.6, 0.9, 1.3, 1.9, 2.7, 4.0)  # bits per pixel
ALL_CHROMA = {"subsampling": "4:4:4"}  # by default, chroma is stored at a quarter of the pixels
CODECS: dict[str, tuple[str, list[dict[str, object]]]] = {
    "JPEG": (
        "JPEG",
        [{"quality": q, "optimize": True} for q in (1, 3, 6, 10, 15, 22, 30, 40, 50, 60, 70, 80, 87, 93)]
        + [{"quality": q, "optimize": True, **ALL_CHROMA} for q in (3, 10, 22, 40, 60, 80, 93)],
    ),
    "WebP": ("WEBP", [{"quality": q, "method": 6} for q in (0, 3, 8, 15, 25, 35, 50, 65, 75, 83, 89, 94, 98)]),
    "AVIF": (
        "AVIF",
        [{"quality": q, "speed": 4} for q in (1, 6, 12, 20, 28, 36, 45, 55, 65, 75, 83, 90, 95)]
        + [{"quality": q, "speed": 6, **ALL_CHROMA} for q in (6, 28, 55, 75, 90, 95)],
    ),
    "JPEG 2000": (
        "JPEG2000",
        [{"quality_mode": "rates", "quality_layers": [24 / bits], "irreversible": True, "mct": 1} for bits in LAYERS],
    ),
}
LOSSLESS = "WebP, lossless"
OURS = "strokes"
Record = dict[str, str]
Curve = list[tuple[float, float]]  # bits per pixel and PSNR


def icons() -> dict[str, Image.Image]:
    """Draw four flat pictures: a ring, a flag, a chart and a badge."""
    side = SIDE * SUPERSAMPLING
    drawings: dict[str, Callable[[ImageDraw.ImageDraw], None]] = {
        "ring": _ring, "flag": _flag, "chart": _chart, "badge": _badge,
    }  # fmt: skip
    pictures = {}
    for name, draw in drawings.items():
        picture = Image.new("RGB", (side, side), "white")
        draw(ImageDraw.Draw(picture))
        pictures[name] = picture.resize((SIDE, SIDE), Image.Resampling.BOX)
    return pictures


def _ring(draw: ImageDraw.ImageDraw) -> None:
    draw.ellipse((100, 100, 668, 668), fill="#d7263d")
    draw.ellipse((220, 220, 548, 548), fill="white")
    draw.rectangle((360, 60, 408, 708), fill="#1b998b")


def _flag(draw: ImageDraw.ImageDraw) -> None:
    draw.rectangle((60, 160, 708, 608), fill="#003f88")
    draw.polygon([(60, 160), (384, 384), (60, 608)], fill="#fdc500")
    draw.ellipse((460, 284, 660, 484), fill="white")


def _chart(draw: ImageDraw.ImageDraw) -> None:
    draw.rectangle((0, 0, 768, 768), fill="#f4f1de")
    bars = ((200, "#e07a5f"), (420, "#3d405b"), (330, "#81b29a"), (560, "#f2cc8f"))
    for place, (height, color) in enumerate(bars):
        draw.rectangle((110 + 145 * place, 670 - height, 210 + 145 * place, 670), fill=color)
    draw.line((80, 672, 700, 672), fill="#222222", width=12)


def _badge(draw: ImageDraw.ImageDraw) -> None:
    draw.rounded_rectangle((80, 80, 688, 688), radius=140, fill="#2d2a6e")
    angles = np.arange(10) * np.pi / 5 - np.pi / 2
    radii = np.where(np.arange(10) % 2, 110, 260)
    draw.polygon(
        [(384 + r * np.cos(a), 384 + r * np.sin(a)) for r, a in zip(radii, angles, strict=True)], fill="#ffd23f"
    )


def pictures(kodak: Path | None) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield the set, name and pixels (H, W, 3) of each picture, alternating between the sets."""
    drawn = [("icons", name, np.asarray(picture)) for name, picture in icons().items()]
    taken = [("scikit-image", name, _downsample(Image.fromarray(getattr(data, name)()), SIDE)) for name in PHOTOGRAPHS]
    paths = [] if kodak is None else [kodak / f"{name}.png" for name in KODAK]
    given = [("Kodak", path.stem, _downsample(Image.open(path).convert("RGB"), SIDE)) for path in paths]
    for turn in zip_longest(drawn, taken, given):
        yield from (picture for picture in turn if picture is not None)


def _downsample(picture: Image.Image, side: int) -> np.ndarray:
    zoom = side / max(picture.size)
    size = round(picture.width * zoom), round(picture.height * zoom)
    return np.asarray(picture.resize(size, Image.Resampling.LANCZOS))


def psnr(picture: np.ndarray, target: np.ndarray) -> float:
    """Compute the PSNR between two 8-bit pictures in dB."""
    return float(-10 * np.log10(np.square((picture.astype(float) - target) / 255).mean() + 1e-12))


def by_codecs(target: np.ndarray) -> Iterator[tuple[str, str, float, float]]:
    """Yield the codec, setting, bits per pixel and PSNR of each file that Pillow writes."""
    for codec, (form, qualities) in CODECS.items():
        for options in qualities:
            Image.fromarray(target).save(file := io.BytesIO(), form, **options)
            decoded = np.asarray(Image.open(file).convert("RGB"))
            setting = " ".join(
                str(options[key]) for key in ("quality", "quality_layers", "subsampling") if key in options
            )
            yield codec, setting, 8 * len(file.getvalue()) / target[..., 0].size, psnr(decoded, target)
    Image.fromarray(target).save(file := io.BytesIO(), "WEBP", lossless=True)
    yield LOSSLESS, "", 8 * len(file.getvalue()) / target[..., 0].size, np.inf


def by_strokes(target: np.ndarray) -> Iterator[tuple[str, str, float, float]]:
    """Paint a picture, encode and decode its strokes, and yield the same values as `by_codecs`."""
    import brushexp  # noqa: PLC0415  (tables need none of it)
    from brushexp.contracts import build_named  # noqa: PLC0415
    from brushexp.contracts.families import Comparison  # noqa: PLC0415

    for count in STROKES:
        keys = {"density": "adaptive", "strokes": count, "steps": STEPS, "threads": 1, "seed": 0}
        painting = brushexp.paint(target, look="plain", **keys)
        job = painting.finished.job.bare()
        image, goal = (torch.from_numpy(np.array(one)).permute(2, 0, 1) / 255 for one in (job.picture(), target))
        metric = build_named("metric", "bits", {"loss": LOSS})
        rate = metric(Comparison(image, goal, None, job.strokes, job))
        yield OURS, f"{count} strokes", rate, metric.remarks["psnr_decoded"]


def paint(records: Path, kodak: Path | None) -> None:
    """Measure the pictures that are missing from the records, and append their rows."""
    done = {(row["set"], row["picture"], row["codec"]) for row in read(records)} if records.exists() else set()
    with records.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not done:
            writer.writerow(FIELDS)
        for group, name, target in pictures(kodak):
            for method in (by_codecs, by_strokes):
                if (group, name, OURS if method is by_strokes else "JPEG") in done:
                    continue
                rows = [
                    (group, name, target.shape[1], target.shape[0], codec, setting, f"{rate:.4f}", f"{quality:.3f}")
                    for codec, setting, rate, quality in method(target)
                ]
                writer.writerows(rows)  # all rows of a picture or none
                file.flush()
            print(group, name, flush=True)


def read(records: Path) -> list[Record]:
    """Read the rows of a records file."""
    with records.open(newline="") as file:
        return list(csv.DictReader(file))


def curves(rows: list[Record]) -> dict[tuple[str, str, str], Curve]:
    """Make a curve for each set, picture and codec: its points sorted by rate, without dominated points."""
    points = defaultdict(list)
    for row in rows:
        points[row["set"], row["picture"], row["codec"]].append((float(row["bits_per_pixel"]), float(row["psnr"])))
    best = {}
    for key, curve in points.items():
        front: Curve = []
        for rate, quality in sorted(curve):
            if not front or quality > front[-1][1]:
                front.append((rate, quality))
        best[key] = front
    return best


def quality_at(curve: Curve, rate: float) -> float:
    """Interpolate the PSNR on a curve at a rate; return nan outside the curve."""
    rates, qualities = np.array(curve).T
    if not rates[0] <= rate <= rates[-1]:
        return float("nan")
    return float(PchipInterpolator(np.log(rates), qualities)(np.log(rate)))


def difference_of_rates(curve: Curve, against: Curve) -> float:
    """Compute Bjontegaard's mean difference in log rate; return nan if the curves share no range of PSNR."""
    low = max(curve[0][1], against[0][1])
    high = min(curve[-1][1], against[-1][1])
    if high <= low:
        return float("nan")
    means = []
    for one in (curve, against):
        rates, qualities = np.array(one).T
        means.append(PchipInterpolator(qualities, np.log(rates)).integrate(low, high) / (high - low))
    return float(means[0] - means[1])


def show(records: Path, figure: Path | None) -> None:
    """Print the tables, and plot the figure if its path is given."""
    found = curves(read(records))
    groups = list(dict.fromkeys(group for group, _, _ in found))
    codecs = [OURS, *CODECS]
    print("| set | pictures | bits per pixel |", " | ".join(codecs), "|\n|---|---:|---:|" + "---:|" * len(codecs))
    for group in groups:
        names = list(dict.fromkeys(name for one, name, _ in found if one == group))
        for rate in RATES:
            table = np.array([[quality_at(found[group, name, codec], rate) for codec in codecs] for name in names])
            everywhere = ~np.isnan(table).any(0)
            if not everywhere[0]:
                continue
            cells = [f"{mean:.1f}" if whole else "–" for mean, whole in zip(table.mean(0), everywhere, strict=True)]
            print(f"| {group} | {len(names)} | {rate:g} |", " | ".join(cells), "|")
    print("\n| set | against | rate of strokes at equal PSNR | 95 % | pictures |\n|---|---|---:|---:|---:|")
    random = np.random.default_rng(0)
    for group in groups:
        names = list(dict.fromkeys(name for one, name, _ in found if one == group))
        for codec in codecs[1:]:
            logs = np.array(
                [difference_of_rates(found[group, name, OURS], found[group, name, codec]) for name in names]
            )
            logs = logs[~np.isnan(logs)]
            if not len(logs):
                print(f"| {group} | {codec} | no common PSNR | | 0 |")
                continue
            means = logs[random.integers(0, len(logs), (SAMPLES, len(logs)))].mean(1)
            low, high = np.exp(np.quantile(means, [0.025, 0.975]))
            print(f"| {group} | {codec} | x {np.exp(logs.mean()):.2f} | {low:.2f} to {high:.2f} | {len(logs)} |")
    print("\n| set | bits per pixel of lossless WebP, mean |\n|---|---:|")
    for group in groups:
        rates = [curve[0][0] for (one, _, codec), curve in found.items() if (one, codec) == (group, LOSSLESS)]
        print(f"| {group} | {np.mean(rates):.2f} |")
    if figure is not None:
        draw(found, groups, codecs, figure)


def draw(found: dict[tuple[str, str, str], Curve], groups: list[str], codecs: list[str], figure: Path) -> None:
    """Plot the curves of all pictures, with one panel per set."""
    import matplotlib  # noqa: PLC0415

    matplotlib.use("Agg")
    from matplotlib import pyplot  # noqa: PLC0415

    drawing, panels = pyplot.subplots(1, len(groups), figsize=(4.2 * len(groups), 4), squeeze=False)
    for panel, group in zip(panels[0], groups, strict=True):
        for number, codec in enumerate(codecs):
            label: str | None = codec
            for (one, _, other), curve in found.items():
                if (one, other) == (group, codec):
                    style = {"linewidth": 2.2, "marker": "o", "markersize": 3} if codec == OURS else {"linewidth": 0.9}
                    panel.plot(
                        *np.array(curve).T, color=f"C{3 if codec == OURS else (number + 6) % 10}", label=label, **style
                    )
                    label = None
        panel.set(xscale="log", xlim=(0.04, 4), ylim=(14, 52), xlabel="bits per pixel", title=group)
        panel.grid(alpha=0.3)
    panels[0][0].set_ylabel("PSNR of the decoded picture, dB")
    panels[0][0].legend(fontsize=8)
    drawing.tight_layout()
    drawing.savefig(figure, dpi=90)


def main() -> None:
    """Parse the command line, and paint pictures or show the records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["paint", "show"])
    parser.add_argument("records", type=Path, help="CSV file")
    parser.add_argument("figure", type=Path, nargs="?", help="PNG file of the figure")
    parser.add_argument("--kodak", type=Path, help="folder with Kodak's pictures")
    options = parser.parse_args()
    if options.what == "paint":
        paint(options.records, options.kodak)
    else:
        show(options.records, options.figure)


if __name__ == "__main__":
    main()
