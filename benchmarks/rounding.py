"""Measure the loss of PSNR and the bits per stroke when strokes are rounded, compared with a plain packing.

    python benchmarks/rounding.py

Three scikit-image photographs are painted at 192 px with 1,024 strokes of `look=plain` in 500 steps. Each painting is
coded twice: with a loss of at most 0.15 dB, and with the loss of the plain packing. The plain packing rounds points,
widths and softness to quarters of a pixel, colours and drifts to 8 bits, opacity to 6 bits, and widening to 5 bits and
a sign, and compresses the columns with LZMA. The printed Markdown table includes the CPU seconds of the first coding.
"""

import lzma
import time
from dataclasses import replace

import brushexp

# isort: split
import numpy as np
import torch
from brushexp_coding.file import read_bits
from brushexp_coding.fitting import Canvas, code, mean_square

from brushexp.contracts.files import to_bytes
from brushexp.contracts.pictures import picture_psnr
from brushexp.contracts.strokes import curve_of, drift_of, half_width_of, softness_of, strokes_along

PHOTOGRAPHS = ("astronaut", "coffee", "chelsea")
SIDE, STROKES, STEPS = 192, 1024, 500
LOSS = 0.15  # dB
PLACES, LEVELS, OPACITIES, WIDENINGS = 4, 255, 63, 31  # steps per pixel, colour, opacity and widening


def pack(strokes):
    """Pack strokes in the plain format; return the compressed bytes and the decoded strokes."""
    start, control, end = curve_of(strokes).unbind(1)
    across = torch.stack([2 * half_width_of(strokes), softness_of(strokes)], dim=1)
    lengths = torch.cat([start, control - start, end - start, across], dim=1) * PLACES
    shares = torch.stack([strokes.opacity * OPACITIES, strokes.widening * WIDENINGS], dim=1)
    numbers = torch.cat([lengths, strokes.color * LEVELS, shares, drift_of(strokes) * LEVELS], dim=1).round()
    columns = np.ascontiguousarray(numbers.short().numpy().T, "<i2").view(np.uint8).reshape(numbers.shape[1], -1, 2)
    filters = [{"id": lzma.FILTER_LZMA1, "preset": 9, "lc": 0, "lp": 0, "pb": 0}]
    packed = lzma.compress(columns.transpose(0, 2, 1).tobytes(), format=lzma.FORMAT_ALONE, filters=filters)
    first, control, last = (numbers[:, 2 * k : 2 * k + 2] / PLACES for k in range(3))
    curve = torch.stack([first, first + control, first + last], 1)
    width, softness, opacity, widening = numbers[:, 6] / PLACES, numbers[:, 7] / PLACES, numbers[:, 11], numbers[:, 12]
    made = strokes_along(curve, width, numbers[:, 8:11] / LEVELS, opacity / OPACITIES)
    rest = {"softness": softness / made.scale, "widening": widening / WIDENINGS, "drift": numbers[:, 13:] / LEVELS}
    return packed, replace(made, **rest)


def row_of(name):
    """Paint a photograph and print its row; return the sizes of the two codings, as fractions of the plain packing."""
    keys = {
        "look": "plain",
        "density": "adaptive",
        "resolution": SIDE,
        "strokes": STROKES,
        "steps": STEPS,
        "threads": 1,
    }
    painting = brushexp.paint(name, **keys)
    job = painting.finished.job.bare()
    canvas, pixels = Canvas(job), painting.target
    goal = torch.from_numpy(pixels).permute(2, 0, 1) / 255

    def draw(strokes):
        with torch.no_grad():
            return canvas.draw(strokes)

    def psnr(picture):
        return picture_psnr(to_bytes(picture), pixels)

    def measure_code(loss):
        allowed = own * (10 ** (loss / 10) - 1)
        data = code(job, allowed=allowed, goal=goal).data
        return 8 * len(data) / len(job.strokes), psnr(draw(read_bits(data).strokes))

    strokes = job.strokes[job.bottom_up].map(lambda value: value.detach().float())
    picture = draw(strokes)
    own, whole = mean_square(picture - goal), psnr(picture)
    packed, plain = pack(strokes)
    bits, lost = 8 * len(packed) / len(strokes), psnr(draw(plain))
    start = time.process_time()
    fine = measure_code(LOSS)
    spent = time.process_time() - start
    coarse = measure_code(whole - lost)
    pairs = "".join(f" | {one:.1f}, {dB:.2f}" for one, dB in ((bits, lost), fine, coarse))
    print(f"| {name} | {whole:.2f}{pairs} | {spent:.1f} |", flush=True)
    return fine[0] / bits, coarse[0] / bits


def main():
    """Print the table, and the mean sizes of the two codings, as fractions of the plain packing."""
    heads = ("plain packing: bits per stroke, PSNR", f"at {LOSS} dB", "at the loss of the plain packing", "CPU, s")
    print(f"| photograph | PSNR of the strokes | {' | '.join(heads)} |\n|---{'|---:' * 5}|")
    shares = np.mean([row_of(name) for name in PHOTOGRAPHS], 0)
    print("\nmean share of the bits of the plain packing: {:.2f} and {:.2f}".format(*shares))


if __name__ == "__main__":
    main()
