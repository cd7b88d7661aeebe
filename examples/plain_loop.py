"""Paint a picture in one plain loop: random initial strokes, a renderer, a squared error, and Adam.

    python examples/plain_loop.py photo.jpg painting.png

`brushexp.paint` runs the same loop, but it starts from the edges in the picture, offers more losses, decreases the
learning rates, orders strokes by size, and replaces weak strokes.
"""

import sys

import numpy as np
import torch
from PIL import Image

import brushexp
from brushexp.contracts.strokes import Strokes, strokes_along

SIDE = 256  # pixels on the longer side of the painting
STROKES = 1000
STEPS = 200
LONGEST, SHORTEST = 80.0, 12.0  # pixels
RATES = {"position": 0.4, "start": 0.02, "control": 0.02, "end": 0.02, "width": 0.004, "color": 0.02}


def load_picture(path: str) -> torch.Tensor:
    """Load a picture (3, H, W) in [0, 1]."""
    picture = Image.open(path).convert("RGB")
    picture.thumbnail((SIDE, SIDE))
    return torch.from_numpy(np.array(picture)).permute(2, 0, 1) / 255


def random_strokes(target: torch.Tensor) -> Strokes:
    """Place straight strokes at random, long ones below short ones, in the colours of the picture at their centres."""
    _, height, width = target.shape
    middle = torch.rand(STROKES, 2) * torch.tensor([width, height])
    column, row = middle.long().T
    length, angle = torch.linspace(LONGEST, SHORTEST, STROKES), torch.pi * torch.rand(STROKES)
    half = torch.stack([angle.cos(), angle.sin()], 1) * length[:, None] / 2
    curve = torch.stack([middle - half, middle, middle + half], 1)
    return strokes_along(curve, length / 4, target[:, row, column].T, 0.95)


def paint(target: torch.Tensor) -> torch.Tensor:
    """Optimise strokes by gradient descent on the squared error to match the target; return the painting."""
    strokes = random_strokes(target).map(lambda value: value.requires_grad_())
    optimizer = torch.optim.Adam([{"params": [getattr(strokes, name)], "lr": rate} for name, rate in RATES.items()])
    for step in range(STEPS):
        image = brushexp.render(strokes, tuple(target.shape[1:]), background=target.mean((1, 2)))
        loss = (image - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        strokes.clamp()  # every number back into its range
        if step % 20 == 0:
            print(f"step {step}, {-10 * loss.log10().item():.2f} dB")
    return image.detach()


if __name__ == "__main__":
    torch.manual_seed(0)
    painting = paint(load_picture(sys.argv[1]))
    Image.fromarray((255 * painting).round().byte().permute(1, 2, 0).numpy()).save(sys.argv[2])
