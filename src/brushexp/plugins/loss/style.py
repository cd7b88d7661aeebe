"""Neural style transfer as a loss: statistics of features, compared with those of a style picture."""

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import torch
from torch import Tensor

from brushexp.bounds import FILE, above, one_of
from brushexp.errors import UserError
from brushexp.features import NETWORKS, open_backbone
from brushexp.pictures.color import recolor
from brushexp.pictures.load import PICTURE, load_picture, size_of_picture
from brushexp.plugins.loss.base import Loss, PaintedView, Surroundings
from brushexp.registry import register

# Taps for style, the first row that a network has: of effl0 the linear outputs of blocks (its rectified insides lead to
# wrong colours and grain), of VGG16 those of Gatys et al. (2016) whose receptive fields are of the size of a stroke.
STYLE_TAPS = (("stem", "b0", "b2", "b4"), ("relu1_1", "relu2_1", "relu3_1", "relu4_1"))
FOURIER_FEATURES = 256  # of each tap
BANDWIDTH_POSITIONS = 512  # positions whose distances give the bandwidth of the gaussian kernel
VARIANCE_OFFSET = 1e-5  # of the style's mean square, added to variances: the root of 0 has no slope
MIN_FEATURE_POWER = 1e-8  # mean square of the style's features that is divided by, at least

Embedding = Callable[[Tensor], Tensor]  # features (C, P) of P positions -> sum over them of what a kernel compares


def waves_for(sample: Tensor) -> Embedding:
    """Random Fourier features (Rahimi and Recht, 2007) of the kernel exp(-|f - g|^2 / (2 s^2)).

    The bandwidth s is the median distance in a sample (C, P) of the style, at least a thousandth of its features'
    length where they are all alike. The waves come from a seed of their own: they are the same in every run.
    """
    sample = sample[:, :: max(1, sample.shape[1] // BANDWIDTH_POSITIONS)].double()
    least = 1e-3 * sample.square().sum(0).mean().sqrt() + MIN_FEATURE_POWER
    width = float(torch.cdist(sample.T, sample.T).median().clamp_min(least))
    generator = torch.Generator().manual_seed(0)
    directions = torch.randn(FOURIER_FEATURES, len(sample), generator=generator, dtype=torch.float64) / width
    phases = 2 * math.pi * torch.rand(FOURIER_FEATURES, 1, generator=generator, dtype=torch.float64)

    def embed(features: Tensor) -> Tensor:
        waves = torch.cos(directions.to(features) @ features + phases.to(features))
        return math.sqrt(2 / FOURIER_FEATURES) * waves.sum(1)

    return embed


class FeatureKernel(NamedTuple):
    """A statistic of features (C, P): what is summed over positions, given a sample of the style, and sum k(f, f)."""

    embedding: Callable[[Tensor], Embedding]
    power: Callable[[Tensor], Tensor] = lambda features: features.square().sum()


KERNELS = {
    "poly": FeatureKernel(lambda sample: lambda f: (f @ f.T).flatten(), lambda f: f.square().sum(0).square().sum()),
    "linear": FeatureKernel(lambda sample: lambda f: f.sum(1)),
    "gaussian": FeatureKernel(waves_for, lambda f: f.new_tensor(f.shape[1])),
    "meanstd": FeatureKernel(lambda sample: lambda f: torch.cat([f.sum(1), f.square().sum(1)])),
}


class TapStyle(NamedTuple):
    """What a picture is compared with in one activation: the style's mean embedding, in units of its mean k(f, f)."""

    kernel: str
    embed: Embedding
    unit: float
    wanted: Tensor = torch.empty(0)

    def sums(self, features: Tensor) -> Tensor:
        """Number of positions and the sum of their embeddings (1 + E,), in double precision; features (C, P)."""
        total = self.embed(features).double()
        return torch.cat([total.new_full((1,), features.shape[1]), total])

    def discrepancy(self, sums: Tensor) -> Tensor:
        """Squared difference of the mean embedding of a picture with these ``sums`` from the style's."""
        found, wanted = sums[1:] / sums[0], self.wanted
        if self.kernel == "meanstd":
            found, wanted = (self._mean_and_deviation(moments) for moments in (found, wanted))
        return (found - wanted).square().sum() / self.unit

    def _mean_and_deviation(self, moments: Tensor) -> Tensor:
        mean, square = moments.chunk(2)
        return torch.cat([mean, ((square - mean.square()).clamp_min(0) + VARIANCE_OFFSET * self.unit).sqrt()])


@register("loss", "style")
class Style(Loss):
    """Style loss (Gram matrices and other kernels, Gatys et al., Li et al.) against a style picture.

    For each tap, with E the mean over the positions of a picture, f a feature vector (C,) there and phi the embedding
    of the kernel: |E phi(f) - E phi(f_style)|^2 / E k(f_style, f_style), and the mean of it over the taps. This is the
    squared maximum mean discrepancy (MMD) in units of the style's own kernel, whatever the kernel, the number of
    channels and the size: 0 is the same style, 2 hardly ever exceeded. A portrait and a painting of stars, in the same
    colours, are 0.08 (poly), 0.09 (gaussian), 0.16 (linear) and 0.19 (meanstd) apart at 256 pixels.

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
        kernel: what is compared: poly (f f^T, the Gram matrix), linear (means of channels), gaussian (256 waves
            sqrt(2/D) cos(W f + b), bandwidth: median distance of the style's positions) or meanstd (means and standard
            deviations).
        backbone: feature network: effl0, or vgg16 (needs ``weights``).
        weights: file with the network's weights; null takes those of its package.
        taps: activations to compare; null or [] takes stem, b0, b2 and b4 of effl0, relu1_1 to relu4_1 of VGG16.
        scale: longer side of the style picture, in longer sides of the canvas: smaller makes its strokes finer. It is
            resampled to that, and has to be as wide and as high as the context of the network (32 pixels for effl0).
        colors: style takes the style picture as it is; content gives it the colours of the target first (see
            `recolor`), so that only its texture is taken over.
    """

    cost = "5.4 x mse"
    looks_at = "canvas"
    exact_on_parts = False

    def __init__(
        self,
        *,
        image: Annotated[str | None, PICTURE] = None,
        kernel: Annotated[str, one_of(*KERNELS)] = "poly",
        backbone: Annotated[str, one_of(*NETWORKS)] = "effl0",
        weights: Annotated[str | None, FILE] = None,
        taps: list[str] | None = None,
        scale: Annotated[float, above(0)] = 1.0,
        colors: Annotated[str, one_of("style", "content")] = "style",
    ) -> None:
        super().__init__()
        self.image, self.kernel, self.scale, self.colors = image, kernel, scale, colors
        self.network = open_backbone(backbone, weights, "style.loss.weights")
        known = (row for row in STYLE_TAPS if set(row) <= set(self.network.taps))
        self.taps = list(taps or next(known, self.network.default_taps))
        self.network.check(self.taps)
        self.context, self.grid = self.network.context, self.network.grid
        self._surroundings: Surroundings | None = None  # where the last step looked; None for the whole canvas
        self._seen = torch.empty(0)  # (3, H, W) the canvas to which the following belongs
        self._rest: list[Tensor] = []  # sums over the canvas without those over what the steps look at

    def check(self, size: tuple[int, int]) -> int:
        """Longer side of the style picture for a canvas of ``size`` (H, W); a UserError if that is too small."""
        side = max(1, round(self.scale * max(size)))
        height, width = size if self.image is None else size_of_picture(self.image, "style", side)
        if (short := min(height, width)) < self.context and self.image is not None:
            least = math.ceil(10 * self.scale * self.context / short) / 10
            raise UserError(
                f"style={self.image} has {width} x {height} pixels at the scale {self.scale:g} of this canvas, but the "
                f"network needs {self.context} x {self.context}; set style.loss.scale={least:g} or more, or a larger "
                "resolution"
            )
        return side

    def picture(self, target: Tensor) -> Tensor:
        """The style picture (3, h, w) as it is used for a whole target (3, H, W); not smaller than ``context``."""
        if self.image is None:
            return target
        side = self.check((target.shape[1], target.shape[2]))
        picture = load_picture(self.image, side, key="style").to(target)
        return recolor(picture, like=target) if self.colors == "content" else picture

    def forward(self, view: PaintedView) -> Tensor:
        styles = self._styles(view.whole_target, self.kernel)
        sums = self._sums(styles, view.image)
        if view.surroundings is None:
            self._surroundings = None
        else:
            if view.surroundings is not self._surroundings:
                self._turn_to(view.surroundings, styles)
            sums = [rest + part for rest, part in zip(self._rest, sums, strict=True)]
        return _distance(styles, sums).to(view.image.dtype)

    @torch.no_grad()
    def measured(self, picture: Tensor, target: Tensor) -> dict[str, float]:
        """Distance of a finished picture (3, H, W) from the style by each kernel, whichever is minimised."""
        every = {kernel: self._styles(target, kernel) for kernel in KERNELS}
        return {kernel: float(_distance(styles, self._tiled_sums(styles, picture))) for kernel, styles in every.items()}

    def _styles(self, target: Tensor, kernel: str) -> list[TapStyle]:
        """Of each tap, what a picture of a whole target is compared with."""

        def compute(target: Tensor) -> list[TapStyle]:
            picture, styles = self.picture(target), []
            tiles = self.network.tiled(picture, self.taps)
            seen = ([_sample_and_power(features, kernel) for features in tile] for tile in tiles)
            for samples, powers, counts in (zip(*parts, strict=True) for parts in zip(*seen, strict=True)):
                unit = max(sum(powers) / sum(counts), MIN_FEATURE_POWER)
                styles.append(TapStyle(kernel, KERNELS[kernel].embedding(torch.cat(samples, 1)), unit))
            sums = self._tiled_sums(styles, picture)
            return [style._replace(wanted=total[1:] / total[0]) for style, total in zip(styles, sums, strict=True)]

        return self.of_target(target, compute, kernel)

    @torch.no_grad()
    def _turn_to(self, around: Surroundings, styles: list[TapStyle]) -> None:
        """Bring the sums over the canvas up to date, and subtract those over what the steps look at from now on."""
        last = self._surroundings
        if last is None or last.picture is not around.picture or last.target is not around.target:
            self._seen = around.picture.clone()
            whole = self._tiled_sums(styles, self._seen)
        else:  # it has changed where the last steps looked, and where the steps look now; the latter is in `forward`
            core = last.core or last.region
            core.of(self._seen).copy_(core.of(around.picture))
            changed = self._sums(styles, last.region.of(self._seen))
            whole = [rest + part for rest, part in zip(self._rest, changed, strict=True)]
        part = self._sums(styles, around.region.of(self._seen))
        self._rest = [a - b for a, b in zip(whole, part, strict=True)]
        self._surroundings = around

    def _sums(self, styles: list[TapStyle], picture: Tensor) -> list[Tensor]:
        """`TapStyle.sums` of each tap of a picture; differentiable."""
        found = self.network(picture[None], self.taps)
        return [style.sums(found[tap][0].flatten(1)) for style, tap in zip(styles, self.taps, strict=True)]

    def _tiled_sums(self, styles: list[TapStyle], picture: Tensor) -> list[Tensor]:
        """The same of a picture of any size, with the memory of a tile of it."""
        tiles = self.network.tiled(picture, self.taps)
        sums = ([style.sums(part) for style, part in zip(styles, tile, strict=True)] for tile in tiles)
        return [torch.stack(parts).sum(0) for parts in zip(*sums, strict=True)]


def _distance(styles: list[TapStyle], sums: list[Tensor]) -> Tensor:
    return torch.stack([style.discrepancy(total) for style, total in zip(styles, sums, strict=True)]).mean()


def _sample_and_power(features: Tensor, kernel: str) -> tuple[Tensor, float, int]:
    """Some of the positions of features (C, P), the sum of k(f, f) over all, and their number."""
    step = max(1, features.shape[1] // BANDWIDTH_POSITIONS)
    return features[:, ::step], float(KERNELS[kernel].power(features.double())), features.shape[1]
