"""Neural style transfer as a loss: statistics of features, compared with those of a style picture."""

from __future__ import annotations

import math
from enum import Enum
from typing import Annotated

import torch
from torch import Tensor

from brushexp.bounds import above
from brushexp.errors import UserError
from brushexp.features import open_backbone
from brushexp.features.context import tiled_activations
from brushexp.pictures.color import recolored
from brushexp.pictures.load import load_picture
from brushexp.plugins.loss._feature_kernels import (
    BANDWIDTH_POSITIONS,
    EMBEDDINGS,
    MIN_FEATURE_POWER,
    POWERS,
    Embedding,
    FeatureKernel,
    discrepancy,
)
from brushexp.plugins.loss.base import Loss, Painting, Surroundings
from brushexp.registry import register

# Taps for style, the first row that a network has: of effl0 the linear outputs of blocks (its rectified insides lead to
# wrong colours and grain), of VGG16 those of Gatys et al. (2016) whose receptive fields are of the size of a stroke.
STYLE_TAPS = (("stem", "b0", "b2", "b4"), ("relu1_1", "relu2_1", "relu3_1", "relu4_1"))


class Colors(Enum):
    """Whose colours the painting gets."""

    style = "style"
    content = "content"


@register("loss", "style")
class Style(Loss):
    """Style loss (Gram matrices and other kernels, Gatys et al., Li et al.) against a style picture.

    For each tap, with E the mean over the positions of a picture, f a feature vector (C,) there and phi the embedding
    of the kernel: |E phi(f) - E phi(f_style)|^2 / E k(f_style, f_style), and the mean of it over the taps. This is the
    squared maximum mean discrepancy (MMD) in units of the style's own kernel, whatever the kernel, the number of
    channels and the size: 0 is the same style, 2 hardly ever exceeded. A portrait and a painting of stars, in the same
    colours, are 0.08 (poly), 0.09 (gaussian), 0.16 (linear) and 0.19 (meanstd) apart at 256 pixels.

    ========  ===================================  ============================================================
    kernel    phi(f)                               k(f, f)
    ========  ===================================  ============================================================
    poly      f f^T: the Gram matrix               |f|^4
    linear    f: the mean of each channel          |f|^2
    gaussian  sqrt(2/D) cos(W f + b), D = 256      1; bandwidth: median distance of 512 positions of the style
    meanstd   mean and standard deviation of f     |f|^2
    ========  ===================================  ============================================================

    Source: Gatys et al. (2016) for poly; Li et al. (2017), "Demystifying neural style transfer", arXiv:1701.01036, for
    the others (meanstd is their matching of batch norms' statistics); Rahimi and Recht (2007) for the random Fourier
    features; thesis 2020, eq. 6.38: sum of w_l / (4 N^2 M^2) |G - A|^2. Differs from it: sums over positions are means,
    and the style's own magnitude replaces 1 / (4 N^2) and w_l, so that taps count alike; the gaussian kernel is taken
    by its random features, fixed once and for all, and not from pairs of sampled positions.

    Statistics are of the whole picture, also where a step looks at a part of the canvas: they are sums over the canvas
    as it was last seen, less those of the part, plus those of the part now. What needs no gradient goes through the
    network in tiles. The statistics belong to no place, so a focus leaves them as they are.

    Args:
        weight: factor in the sum of losses. Beside ``mse`` at its weight of 1 (``style.content=1``), 0.1 leaves a
            photograph with a trace of the style, 1 a painting whose subject is plain, 10 one where it can be guessed.
        image: the style picture, a path or a sample's name; null takes the target itself, whose style a perfect
            picture has.
        kernel: poly, linear, gaussian or meanstd.
        backbone: feature network: effl0, vgg16 (needs ``weights``) or vgg16-hed (needs its package).
        weights: file with the network's weights; null takes those of its package.
        taps: activations to compare; null or [] takes stem, b0, b2 and b4 of effl0, relu1_1 to relu4_1 of VGG16.
        scale: longer side of the style picture, in longer sides of the canvas: smaller makes its strokes finer. It is
            resampled to that, and has to be as wide and as high as the context of the network (32 pixels for effl0).
        colors: style takes the style picture as it is; content gives it the colours of the target first (see
            `recolored`), so that only its texture is taken over.
    """

    cost = "5.4 x mse"
    looks_at = "canvas"
    exact_on_parts = False

    def __init__(
        self,
        *,
        weight: float = 1.0,
        image: str | None = None,
        kernel: FeatureKernel = FeatureKernel.poly,
        backbone: str = "effl0",
        weights: str | None = None,
        taps: list[str] | None = None,
        scale: Annotated[float, above(0)] = 1.0,
        colors: Colors = Colors.style,
    ) -> None:
        super().__init__(weight)
        if image is not None:
            load_picture(image, 1, key="style")  # a wrong path is told before work starts
        self.image = image
        self.kernel = kernel
        self.scale = scale
        self.colors = colors
        self.network = open_backbone(backbone, weights, "style.loss.weights")
        self.taps = list(
            taps or next((row for row in STYLE_TAPS if set(row) <= set(self.network.taps)), self.network.default_taps)
        )
        self.network.check(self.taps)
        self.context, self.grid = self.network.context, self.network.grid
        self._target: Tensor | None = None  # the whole target to which the next three belong
        self._embeddings: list[Embedding] = []  # of each tap
        self._wanted: list[Tensor] = []  # their means over the style picture
        self._units: list[float] = []  # mean of k(f, f) over it
        self._surroundings: Surroundings | None = None  # where the last step looked; None for the whole canvas
        self._seen = torch.empty(0)  # (3, H, W) the canvas to which the following belongs
        self._rest: list[Tensor] = []  # sums over the canvas without those over what the steps look at

    def picture(self, target: Tensor) -> Tensor:
        """The style picture (3, h, w) as it is used for a whole target (3, H, W).

        Raises:
            UserError: if it is smaller than the context of the network.
        """
        if self.image is None:
            return target
        side = max(1, round(self.scale * max(target.shape[1:])))
        picture = load_picture(self.image, side, key="style").to(target)
        short = min(picture.shape[1:])
        field = self.network.context
        if short < field:
            least = math.ceil(10 * self.scale * field / short) / 10
            raise UserError(
                f"style={self.image} has {picture.shape[2]} x {picture.shape[1]} pixels at the scale {self.scale:g} of "
                f"this canvas, but the network needs {field} x {field}; set style.loss.scale={least:g} "
                "or more, or a larger resolution"
            )
        return recolored(picture, like=target) if self.colors is Colors.content else picture

    def forward(self, painting: Painting) -> Tensor:
        if painting.whole_target is not self._target:
            self._prepare(painting.whole_target)
        sums = self._sums(painting.image)
        if painting.surroundings is None:
            self._surroundings = None
        else:
            if painting.surroundings is not self._surroundings:
                self._turn_to(painting.surroundings)
            sums = [rest + part for rest, part in zip(self._rest, sums, strict=True)]
        return self._discrepancy(sums).to(painting.image.dtype)

    @torch.no_grad()
    def measured(self, picture: Tensor, target: Tensor) -> dict[str, float]:
        """Distance of a finished picture (3, H, W) from the style by each kernel, whichever is minimised."""
        own, found = self.kernel, {}
        for kernel in FeatureKernel:
            self.kernel = kernel
            self._prepare(target)
            found[kernel.name] = float(self._discrepancy(self._tiled_sums(picture)))
        self.kernel, self._target = own, None
        return found

    @torch.no_grad()
    def _prepare(self, target: Tensor) -> None:
        """Fix the embeddings and their means over the style picture."""
        picture = self.picture(target)
        samples: list[list[Tensor]] = [[] for _ in self.taps]
        powers = [0.0 for _ in self.taps]
        for tile in tiled_activations(self.network, self.taps, picture):
            for i, features in enumerate(tile):
                samples[i].append(features[:, :: max(1, features.shape[1] // BANDWIDTH_POSITIONS)])
                powers[i] += float(POWERS[self.kernel](features.double()))
        self._embeddings = [EMBEDDINGS[self.kernel](torch.cat(sample, 1)) for sample in samples]
        sums = self._tiled_sums(picture)
        self._wanted = [total[1:] / total[0] for total in sums]
        self._units = [max(power / float(n), MIN_FEATURE_POWER) for power, (n, *_) in zip(powers, sums, strict=True)]
        self._target, self._surroundings = target, None

    @torch.no_grad()
    def _turn_to(self, around: Surroundings) -> None:
        """Bring the sums over the canvas up to date, and subtract those over what the steps look at from now on."""
        last, picture = self._surroundings, around.picture
        if last is None or last.picture is not picture:
            self._seen = picture.clone()
            whole = self._tiled_sums(self._seen)
        else:  # it has changed where the last steps looked, and where the steps look now; the latter is in `forward`
            core = last.core or last.region
            core.of(self._seen).copy_(core.of(picture))
            changed = self._sums(last.region.of(self._seen))
            whole = [rest + part for rest, part in zip(self._rest, changed, strict=True)]
        self._rest = [a - b for a, b in zip(whole, self._sums(around.region.of(self._seen)), strict=True)]
        self._surroundings = around

    def _discrepancy(self, sums: list[Tensor]) -> Tensor:
        """The loss of a picture with these sums."""
        found = [
            discrepancy(total[1:] / total[0], wanted, unit, self.kernel)
            for total, wanted, unit in zip(sums, self._wanted, self._units, strict=True)
        ]
        return torch.stack(found).mean()

    def _sums(self, picture: Tensor) -> list[Tensor]:
        """Number of positions and the sum of their embeddings (1 + E,) of each tap; differentiable."""
        found = self.network(picture[None], self.taps)
        return self._embedded([found[tap][0].flatten(1) for tap in self.taps])

    def _tiled_sums(self, picture: Tensor) -> list[Tensor]:
        """The same of a picture of any size, with the memory of a tile of it."""
        sums = [self._embedded(tile) for tile in tiled_activations(self.network, self.taps, picture)]
        return [torch.stack(parts).sum(0) for parts in zip(*sums, strict=True)]

    def _embedded(self, activations: list[Tensor]) -> list[Tensor]:
        """Number of positions and the sum of their embeddings for activations (C, positions), in double precision."""
        sums = []
        for embed, features in zip(self._embeddings, activations, strict=True):
            total = embed(features).double()
            sums.append(torch.cat([total.new_full((1,), features.shape[1]), total]))
        return sums
