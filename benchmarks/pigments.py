"""Compute the reflectances of the paints that color=pigment mixes.

    python benchmarks/pigments.py        (less than a minute)

The unknowns are the fractions of light that six pure paints reflect in seven bands; white reflects all light. These
fractions determine the matrix from bands to linear RGB, which reproduces the colour of each paint exactly. The terms of
a least-squares fit are the differences between mixtures (geometric means) of two paints and the colours in MIXTURES,
the amounts by which mixtures exceed the display gamut, and the roughness of the spectra and the matrix. The target
colours are those that painters expect, not measurements.
"""

import torch
from brushexp_media.colors.decoding import display_of, linear_of
from brushexp_media.colors.pigment import DEEPEST, PURE, paints
from torch import Tensor

BANDS, STEPS, RATE = 7, 4000, 0.02
MIXTURES = {  # two colours in equal parts, and their mixture
    "0000ff ffff00": "1f8a3c", "002185 fcd200": "2a7a35", "1a4fc0 f5d90a": "2f9a44", "00ffff ffff00": "5fe05a",
    "00ffff ff00ff": "4a4ae0", "ff00ff ffff00": "f04a35", "ff0000 ffff00": "ff8a10", "ff0000 0000ff": "70206a",
    "ff0000 00ff00": "80752a", "ff0000 ffffff": "ff8c8c", "0000ff ffffff": "7f9cff", "00ff00 ffffff": "a0ffa0",
    "ffff00 ffffff": "ffffa0", "ff7f00 0050ff": "77707a", "ff0000 00ffff": "806a70", "ff00ff 00ff00": "807a80",
}  # fmt: skip


def color(text: str) -> Tensor:
    """Parse a colour from its hexadecimal digits."""
    return torch.tensor([int(text[k : k + 2], 16) / 255 for k in (0, 2, 4)], dtype=torch.float64)


def logarithms(light: Tensor, spectra: Tensor) -> Tensor:
    """Return the logarithms of linear RGB colours' reflectances in each band, before conversion to channels."""
    return (paints(light) @ spectra + DEEPEST).log()


def initial_logits() -> Tensor:
    """Return the logits of the initial spectra, which are blocks with soft edges."""
    place = torch.linspace(0, 1, BANDS, dtype=torch.float64)

    def block(low: float, high: float) -> Tensor:
        return torch.sigmoid((place - low) / 0.08) * torch.sigmoid((high - place) / 0.08)

    blocks = block(-1, 0.6), 1 - block(0.3, 0.6), block(0.35, 2), block(0.65, 2), block(0.3, 0.65), block(-1, 0.35)
    return torch.stack(blocks).clamp(0.03, 0.97).logit()


def main() -> None:
    """Fit the reflectances, and print the table, the matrix and the mixtures."""
    torch.manual_seed(0)
    pure, white = torch.tensor(PURE, dtype=torch.float64), torch.ones(1, BANDS, dtype=torch.float64)
    light = [torch.stack([linear_of(color(pair.split()[k])) for pair in MIXTURES]) for k in (0, 1)]
    wanted = torch.stack([color(text) for text in MIXTURES.values()])
    numbers = initial_logits().requires_grad_()
    optimizer = torch.optim.Adam([numbers], lr=RATE)
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.01, STEPS)
    for _ in range(STEPS):
        spectra = torch.cat([white, numbers.sigmoid()])
        seen = torch.linalg.solve(spectra, pure)
        one, other = (logarithms(part, spectra) for part in light)
        mixed = display_of((0.5 * (one + other)).exp().sub(DEEPEST) @ seen)
        first, second = linear_of((torch.rand(2, 256, 3, dtype=torch.float64) * 1.6 - 0.3).clamp(0, 1))
        chance = torch.lerp(logarithms(first, spectra), logarithms(second, spectra), torch.rand(256, 1).double())
        shown = display_of(chance.exp().sub(DEEPEST) @ seen)
        outside = (shown - shown.clamp(0, 1)).square().sum()
        rough = 0.01 * (spectra[1:] + DEEPEST).log().diff(n=2).square().mean() + 0.05 * seen.T.diff(n=2).square().mean()
        loss = (mixed - wanted).square().sum() + 0.3 * outside + rough
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    torch.set_printoptions(precision=4, sci_mode=False, linewidth=120)
    print(spectra.detach(), seen.T.detach(), sep="\n")
    for (pair, text), found in zip(MIXTURES.items(), mixed, strict=True):
        print(f"{pair}: wanted {text}, found {bytes((255 * found.clamp(0, 1) + 0.5).byte().tolist()).hex()}")


if __name__ == "__main__":
    main()
