"""Compare the number of strokes that strokes=auto psnr=30 chooses with the smallest fixed number that reaches 30 dB.

    python benchmarks/worth.py
    python benchmarks/worth.py --scenes emblem,horse --side 96
    python benchmarks/worth.py --prices   (the default price per stroke, on a logo, a portrait and a street at 512 px)

An oracle paints repeatedly with `look=plain density=traced_surplus`, a fixed number of strokes and 500 steps. It
searches for the smallest sufficient number of strokes, and stops at a number within 4 % of an insufficient number.
strokes=auto takes at most 1,000 steps. The scenes are drawn by this script or come from scikit-image; they are a
development set.
"""

import argparse
import math
import random
from collections.abc import Callable, Mapping
from typing import Any

import brushexp

# isort: split
import numpy as np
import skimage.data
from PIL import Image, ImageDraw

DRAWN = 768  # pixels on the longer side of a drawn scene before resampling
TOLERANCE = 1.04  # ratio of the oracle's two numbers of strokes at which its search ends
DECIBELS_PER_DOUBLING = 3.0  # first guess of the gain from twice as many strokes
MOST_PAINTINGS = 8
PHOTOGRAPHS = ("horse", "logo", "moon", "rocket", "coffee", "chelsea", "astronaut", "motorcycle")
PRICED = ("emblem", "astronaut", "street")


def emblem() -> Image.Image:
    """Draw a logo of five flat shapes."""
    picture = Image.new("RGB", (DRAWN, DRAWN), (245, 243, 238))
    draw = ImageDraw.Draw(picture)
    draw.ellipse((96, 96, 672, 672), fill=(28, 84, 140))
    draw.ellipse((200, 200, 568, 568), fill=(245, 200, 60))
    draw.rectangle((340, 96, 428, 672), fill=(200, 40, 50))
    draw.polygon([(384, 250), (500, 520), (268, 520)], fill=(250, 250, 250))
    return picture


def flag() -> Image.Image:
    """Draw a flag with stripes and stars."""
    picture = Image.new("RGB", (DRAWN, DRAWN // 2), (250, 250, 250))
    draw = ImageDraw.Draw(picture)
    for row in range(0, 13, 2):
        draw.rectangle((0, row * 30, DRAWN, row * 30 + 29), fill=(178, 34, 52))
    draw.rectangle((0, 0, 300, 210), fill=(60, 59, 110))
    for number in range(20):
        x, y = 30 + number % 5 * 60, 27 + number // 5 * 50
        points = [
            (x + radius * math.sin(turn * math.pi / 5), y - radius * math.cos(turn * math.pi / 5))
            for turn, radius in enumerate([18, 7] * 5)
        ]
        draw.polygon(points, fill=(250, 250, 250))
    return picture


def horizon() -> Image.Image:
    """Draw a sunset with a smoothly coloured sky, a sun and three hills."""
    y, x = np.mgrid[0:1:512j, 0:1:768j]
    sky = np.stack([0.95 - 0.5 * (1 - y), 0.6 - 0.3 * (1 - y), 0.35 + 0.4 * (1 - y)], axis=-1)
    sky[(x - 0.3) ** 2 + ((y - 0.5) * 2 / 3) ** 2 < 0.005] = (1.0, 0.93, 0.7)
    for depth, (height, waves) in enumerate([(0.55, 2.0), (0.68, 3.3), (0.82, 5.1)]):
        hill = y > height + 0.05 * np.sin(2 * math.pi * (waves * x + 0.37 * depth))
        sky[hill] = np.array([0.30, 0.28, 0.36]) * (1 - 0.3 * depth)
    return Image.fromarray((255 * sky.clip(0, 1)).astype(np.uint8))


def street() -> Image.Image:
    """Draw a street of houses with windows, people and paving stones."""
    chance = random.Random(0)
    picture = Image.new("RGB", (DRAWN, DRAWN * 3 // 4), (170, 200, 225))
    draw, left = ImageDraw.Draw(picture), 0

    def shade(low: int, high: int) -> tuple[int, int, int]:
        return chance.randint(low, high), chance.randint(low, high), chance.randint(low, high)

    while left < DRAWN:
        width, top = chance.randint(70, 130), chance.randint(20, 190)
        draw.rectangle((left, top, left + width, 430), fill=shade(110, 220))
        for y in range(top + 16, 400, 38):
            for x in range(left + 8, left + width - 18, 26):
                draw.rectangle((x, y, x + 15, y + 24), fill=shade(20, 120), outline=shade(200, 250), width=2)
        left += width
    draw.rectangle((0, 430, DRAWN, DRAWN), fill=(120, 115, 110))
    for y in range(440, DRAWN * 3 // 4, 18):
        for x in range(-(y % 36), DRAWN, 36):
            draw.rectangle((x, y, x + 33, y + 15), fill=shade(95, 150))
    for _ in range(26):
        x, y = chance.randint(0, DRAWN), chance.randint(400, 520)
        draw.ellipse((x + 3, y - 12, x + 13, y), fill=shade(60, 220))
        draw.rectangle((x, y, x + 16, y + 40), fill=shade(20, 200))
    return picture


def photograph(name: str) -> Image.Image:
    """Load a scikit-image photograph as RGB."""
    pixels = skimage.data.stereo_motorcycle()[0] if name == "motorcycle" else getattr(skimage.data, name)()
    return Image.fromarray(pixels if pixels.dtype == np.uint8 else (255 * pixels).astype(np.uint8)).convert("RGB")


DRAWINGS: Mapping[str, Callable[[], Image.Image]] = {one.__name__: one for one in (emblem, flag, horizon, street)}
SCENES = (*DRAWINGS, *PHOTOGRAPHS)


def scene(name: str, side: int) -> Image.Image:
    """Draw or load a scene, and resize it to ``side`` pixels on its longer side."""
    picture = DRAWINGS[name]() if name in DRAWINGS else photograph(name)
    zoom = side / max(picture.size)
    width, height = (max(1, round(zoom * length)) for length in picture.size)
    return picture.resize((width, height), Image.Resampling.LANCZOS)


def figures_of(picture: Image.Image, **keys: Any) -> Mapping[str, Any]:
    """Paint a picture with look=plain on one thread, and return its metrics."""
    return brushexp.paint(picture, look="plain", metric=["psnr"], frames=0, threads=1, **keys).metrics


def fewest(picture: Image.Image, psnr: float, guess: int) -> tuple[int, int]:
    """Find the smallest fixed number of strokes that reaches a PSNR; return it and the number of paintings needed.

    This is a secant search, because PSNR is nearly linear in the logarithm of the number of strokes.
    """
    seen: dict[int, float] = {}
    count = guess
    while count not in seen and len(seen) < MOST_PAINTINGS:
        seen[count] = figures_of(picture, density="traced_surplus", strokes=count)["psnr"]
        enough = min((n for n in seen if seen[n] >= psnr), default=None)
        short = max((n for n in seen if seen[n] < psnr and (enough is None or n < enough)), default=None)
        if enough is None or short is None:
            doublings = (psnr - seen[count]) / DECIBELS_PER_DOUBLING
            count = max(1, round(count * 2 ** (doublings + math.copysign(0.1, doublings))))
            continue
        if enough <= max(short + 1, TOLERANCE * short):
            break
        share = (psnr - seen[short]) / (seen[enough] - seen[short])
        share = min(0.8, max(0.2, share))
        count = min(enough - 1, max(short + 1, round(short * (enough / short) ** share)))
    return min((n for n in seen if seen[n] >= psnr), default=0), len(seen)


def compare(names: list[str], side: int, psnr: float) -> None:
    """Print the numbers of strokes that strokes=auto and the oracle choose for each scene."""
    print(f"| scene, {side} px | strokes=auto psnr={psnr:g} | PSNR, dB | CPU, s | oracle | ratio |")
    print("|---|---|---|---|---|---|", flush=True)
    for name in names:
        picture = scene(name, side)
        found = figures_of(picture, density="worth", psnr=psnr)
        count = found["n_strokes"]
        oracle, _ = fewest(picture, psnr, count)
        ratio = f"{count / oracle:.2f}" if oracle else "-"
        numbers = f"{count} | {found['psnr']:.2f} | {found['cpu_seconds']:.1f} | {oracle or 'not reached'} | {ratio}"
        print(f"| {name} | {numbers} |", flush=True)


def price(names: list[str], side: int) -> None:
    """Print the number of strokes that strokes=auto chooses for each scene at the default price per stroke."""
    print(f"| scene, {side} px | strokes=auto | PSNR, dB | steps | CPU, s |")
    print("|---|---|---|---|---|", flush=True)
    for name in names:
        found = figures_of(scene(name, side), density="worth")
        numbers = f"{found['n_strokes']} | {found['psnr']:.2f} | {found['steps']} | {found['cpu_seconds']:.1f}"
        print(f"| {name} | {numbers} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", help="names, separated by commas", default="")
    parser.add_argument("--side", type=int, default=0, help="pixels on the longer side")
    parser.add_argument("--psnr", type=float, default=30.0)
    parser.add_argument("--prices", action="store_true", help="compare scenes at the same price")
    chosen = parser.parse_args()
    if chosen.prices:
        price(chosen.scenes.split(",") if chosen.scenes else list(PRICED), chosen.side or 512)
    else:
        compare(chosen.scenes.split(",") if chosen.scenes else list(SCENES), chosen.side or 192, chosen.psnr)
