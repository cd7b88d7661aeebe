"""The loss that compares which textures and colours there are, wherever they are."""

from __future__ import annotations

import math
from enum import Enum

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.features import open_backbone
from brushexp.features.sight import Sight, activations_of, sight_of, tiles
from brushexp.pictures.color import recolored
from brushexp.pictures.load import load_picture
from brushexp.pictures.region import Region
from brushexp.plugins.loss._kernels import EMBEDDINGS, FLOOR, POWERS, SAMPLE, Embedding, Kernel, discrepancy
from brushexp.plugins.loss.base import Loss, Painting, Surroundings
from brushexp.registry import register

# Taps for style, the first row that a network has: of effl0 the linear outputs of blocks (its rectified insides lead to
# wrong colours and grain), of VGG16 those of Gatys et al. (2016) that see the size of a stroke.
TAPS = (("stem", "b0", "b2", "b4"), ("relu1_1", "relu2_1", "relu3_1", "relu4_1"))


class Colors(Enum):
    """Whose colours the painting gets."""

    style = "style"
    content = "content"


@register("loss", "style")
class Style(Loss):
    """How far the statistics of deep features are from those of a style picture: colours, textures, strokes.

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

    Statistics are of the whole picture, also where a step looks at a part: then the sums over the canvas as it was last
    seen, less those of the part, plus those of the part now. What needs no gradient is looked at in tiles. They are of
    no place, so a focus leaves them as they are.

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
            resampled to that, and has to be as wide and as high as the field that one activation sees (67 pixels for
            effl0).
        colors: style takes the style picture as it is; content gives it the colours of the target first (see
            `recolored`), so that only its texture is taken over.
    """

    over_pixels = False

    def __init__(
        self,
        *,
        weight: float = 1.0,
        image: str | None = None,
        kernel: Kernel = Kernel.poly,
        backbone: str = "effl0",
        weights: str | None = None,
        taps: list[str] | None = None,
        scale: float = 1.0,
        colors: Colors = Colors.style,
    ) -> None:
        super().__init__()
        if not (math.isfinite(scale) and scale > 0):
            raise UserError(f"the scale {scale:g} of the style is not a positive number; try style.loss.scale=1")
        if image is not None:
            load_picture(image, 1, key="style")  # a wrong path is told before work starts
        self.weight = weight
        self.image = image
        self.kernel = kernel
        self.scale = scale
        self.colors = colors
        self.network = open_backbone(backbone, weights, "style.loss.weights")
        self.taps = list(
            taps or next((row for row in TAPS if set(row) <= set(self.network.taps)), self.network.default_taps)
        )
        self.network.check(self.taps)
        self._target: Tensor | None = None  # the whole target to which the following belongs
        self._embeddings: list[Embedding] = []  # of each tap
        self._wanted: list[Tensor] = []  # their means over the style picture
        self._units: list[float] = []  # mean of k(f, f) over it
        self._surroundings: Surroundings | None = None  # the canvas of the last step, to which the following belongs
        self._seen: Tensor | None = None  # its picture
        self._whole: list[Tensor] = []  # sums over it
        self._rest: list[Tensor] = []  # sums over it without what the step looks at

    @property
    def sight(self) -> Sight:
        """What the taps see."""
        return sight_of(self.network, self.taps)

    def picture(self, target: Tensor) -> Tensor:
        """The style picture (3, h, w) as it is used for a whole target (3, H, W).

        Raises:
            UserError: if it is smaller than the field of the farthest tap.
        """
        if self.image is None:
            return target
        side = max(1, round(self.scale * max(target.shape[1:])))
        picture = load_picture(self.image, side, key="style").to(target)
        short = min(picture.shape[1:])
        if short < self.sight.field:
            field, least = self.sight.field, math.ceil(10 * self.scale * self.sight.field / short) / 10
            raise UserError(
                f"style={self.image} has {picture.shape[2]} x {picture.shape[1]} pixels at the scale {self.scale:g} of "
                f"this canvas, but one activation sees {field} x {field}; set style.loss.scale={least:g} "
                "or more, or a larger resolution"
            )
        return recolored(picture, like=target) if self.colors is Colors.content else picture

    def forward(self, painting: Painting) -> Tensor:
        around = painting.surroundings
        if painting.whole_target is not self._target:
            self._look_at_style(painting.whole_target)
        if around is None:
            sums = self._sums(painting.image)
        else:
            if around is not self._surroundings:
                self._look_around(around)
            part = self._sums_of_part(painting, around)
            sums = [rest + seen for rest, seen in zip(self._rest, part, strict=True)]
        return self._apart(sums).to(painting.image.dtype)

    @torch.no_grad()
    def measured(self, picture: Tensor, target: Tensor) -> dict[str, float]:
        """How far a finished picture (3, H, W) is from the style, by each kernel, whichever is minimised."""
        own, found = self.kernel, {}
        for kernel in Kernel:
            self.kernel = kernel
            self._look_at_style(target)
            found[kernel.name] = float(self._apart(self._tiled_sums(picture, _all_of(picture))))
        self.kernel, self._target = own, None
        return found

    def _apart(self, sums: list[Tensor]) -> Tensor:
        """The loss for a picture with these sums."""
        apart = [
            discrepancy(total[1:] / total[0], wanted, unit, self.kernel)
            for total, wanted, unit in zip(sums, self._wanted, self._units, strict=True)
        ]
        return torch.stack(apart).mean()

    @torch.no_grad()
    def _look_at_style(self, target: Tensor) -> None:
        """Fix the embeddings and what their means are to be."""
        picture = self.picture(target)
        samples: list[list[Tensor]] = [[] for _ in self.taps]
        powers = [0.0 for _ in self.taps]
        for tile in tiles(_all_of(picture)):
            for i, features in enumerate(self._activations(picture, tile)):
                samples[i].append(features[:, :: max(1, features.shape[1] // SAMPLE)])
                powers[i] += float(POWERS[self.kernel](features.double()))
        self._embeddings = [EMBEDDINGS[self.kernel](torch.cat(sample, 1)) for sample in samples]
        sums = self._tiled_sums(picture, _all_of(picture))
        self._wanted = [total[1:] / total[0] for total in sums]
        self._units = [max(power / float(total[0]), FLOOR) for power, total in zip(powers, sums, strict=True)]
        self._target, self._surroundings, self._seen = target, None, None

    @torch.no_grad()
    def _look_around(self, around: Surroundings) -> None:
        """Bring the sums over the canvas up to date, and leave out of them what the steps look at from now on."""
        picture = around.picture
        if self._seen is None or self._seen.shape != picture.shape:
            self._seen = picture.clone()
            self._whole = self._tiled_sums(picture, _all_of(picture))
        else:
            if self._surroundings is not None:
                self._renew(picture, self._surroundings.region)
            for tile in tiles(_all_of(picture)):  # whatever else has changed
                rows, columns = ((tile.of(picture) != tile.of(self._seen)).any(0).any(axis) for axis in (1, 0))
                if rows.any():
                    (top, bottom), (left, right) = (x.nonzero()[[0, -1], 0].tolist() for x in (rows, columns))
                    self._renew(picture, Region(tile.top + top, tile.left + left, bottom - top + 1, right - left + 1))
        part = self._tiled_sums(self._seen, self.sight.touched(around.region, _size(picture)))
        self._rest = [whole - seen for whole, seen in zip(self._whole, part, strict=True)]
        self._surroundings = around

    def _renew(self, picture: Tensor, region: Region) -> None:
        """Take a region of the picture over into the canvas as it was last seen, and into the sums over it."""
        assert self._seen is not None
        zone = self.sight.touched(region, _size(picture))
        before = self._tiled_sums(self._seen, zone)
        region.of(self._seen).copy_(region.of(picture))
        after = self._tiled_sums(self._seen, zone)
        self._whole = [w - b + a for w, b, a in zip(self._whole, before, after, strict=True)]

    def _sums_of_part(self, painting: Painting, around: Surroundings) -> list[Tensor]:
        """Sums over all positions that see something of the region, differentiable in its picture."""
        size = _size(around.picture)
        margin = self.sight.margin + self.sight.grid  # the zone is rounded up to the grid
        frame, image = around.wide(margin, self.sight.grid), painting.around(margin, self.sight.grid).image

        def cut(part: Region) -> Tensor:
            return Region(part.top - frame.top, part.left - frame.left, part.height, part.width).of(image)

        zone = self.sight.touched(around.region, size)
        return self._embedded(activations_of(self.network, self.taps, self.sight, zone, size, cut))

    def _tiled_sums(self, picture: Tensor, zone: Region) -> list[Tensor]:
        """Sums over a zone of a picture, with memory for a tile of it."""
        sums = [self._embedded(self._activations(picture, tile)) for tile in tiles(zone)]
        return [torch.stack(parts).sum(0) for parts in zip(*sums, strict=True)]

    def _sums(self, picture: Tensor) -> list[Tensor]:
        """Sums over a whole picture at once, differentiable."""
        return self._embedded(self._activations(picture, _all_of(picture)))

    def _activations(self, picture: Tensor, zone: Region) -> list[Tensor]:
        return activations_of(
            self.network, self.taps, self.sight, zone, _size(picture), lambda region: region.of(picture)
        )

    def _embedded(self, activations: list[Tensor]) -> list[Tensor]:
        """Number of positions and the sum of their embeddings (1 + E,) of each tap, in double precision."""
        sums = []
        for embed, features in zip(self._embeddings, activations, strict=True):
            total = embed(features).double()
            sums.append(torch.cat([total.new_full((1,), features.shape[1]), total]))
        return sums


def _size(picture: Tensor) -> tuple[int, int]:
    return picture.shape[1], picture.shape[2]


def _all_of(picture: Tensor) -> Region:
    return Region(0, 0, *_size(picture))
