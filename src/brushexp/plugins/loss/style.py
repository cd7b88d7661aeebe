"""Transfer style by comparing feature statistics with those of a style picture."""

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
from brushexp.plugins.loss.base import PaintedView, StyleLoss, Surroundings
from brushexp.registry import register

# Taps for style; the first row that a network has is used. Of effl0, the linear outputs of blocks (its rectified
# expansions lead to wrong colours and grain); of VGG16, those of Gatys et al. (2016) whose receptive fields have the
# size of a stroke.
STYLE_TAPS = (("stem", "b0", "b2", "b4"), ("relu1_1", "relu2_1", "relu3_1", "relu4_1"))
FOURIER_FEATURES = 256  # number of random features per tap
BANDWIDTH_POSITIONS = 512  # number of positions whose distances determine the bandwidth of the gaussian kernel
VARIANCE_OFFSET = 1e-5  # fraction of the style's mean square, added to variances because the root has no slope at 0
MIN_FEATURE_POWER = 1e-8  # smallest mean square of the style's features in a denominator

Embedding = Callable[[Tensor], Tensor]  # features (C, P) at P positions -> sum of their embeddings


def waves_for(sample: Tensor) -> Embedding:
    """Create random Fourier features (Rahimi and Recht, 2007) for the kernel exp(-|f - g|^2 / (2 s^2)).

    The bandwidth s is the median distance between features in a sample (C, P) of the style, but at least a thousandth
    of the features' root mean square length. The seed is fixed, so the features are the same in every run.
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
    """A kernel on features (C, P): an embedding built from a style sample, and the sum of k(f, f) over positions."""

    embedding: Callable[[Tensor], Embedding]
    power: Callable[[Tensor], Tensor] = lambda features: features.square().sum()


KERNELS = {
    "poly": FeatureKernel(lambda sample: lambda f: (f @ f.T).flatten(), lambda f: f.square().sum(0).square().sum()),
    "linear": FeatureKernel(lambda sample: lambda f: f.sum(1)),
    "gaussian": FeatureKernel(waves_for, lambda f: f.new_tensor(f.shape[1])),
    "meanstd": FeatureKernel(lambda sample: lambda f: torch.cat([f.sum(1), f.square().sum(1)])),
}


class TapStyle(NamedTuple):
    """The style at one tap: its mean embedding, and the mean of k(f, f), which is the unit of the distance."""

    kernel: str
    embed: Embedding
    unit: float
    mean: Tensor = torch.empty(0)

    def sums(self, features: Tensor) -> Tensor:
        """Return the number of positions and the summed embedding (1 + E,) of features (C, P), in double precision."""
        total = self.embed(features).double()
        return torch.cat([total.new_full((1,), features.shape[1]), total])

    def discrepancy(self, sums: Tensor) -> Tensor:
        """Compute the squared distance between the mean embeddings of the style and a picture with these ``sums``."""
        ours, theirs = sums[1:] / sums[0], self.mean
        if self.kernel == "meanstd":
            ours, theirs = (self._mean_and_deviation(moments) for moments in (ours, theirs))
        return (ours - theirs).square().sum() / self.unit

    def _mean_and_deviation(self, moments: Tensor) -> Tensor:
        mean, square = moments.chunk(2)
        return torch.cat([mean, ((square - mean.square()).clamp_min(0) + VARIANCE_OFFSET * self.unit).sqrt()])


@register("loss", "style")
class Style(StyleLoss):
    """Style loss with respect to a style picture, with Gram matrices or other kernels (Gatys et al., Li et al.).

    The loss is |E phi(f) - E phi(f_style)|^2 / E k(f_style, f_style), averaged over the taps, where E is the mean over
    the positions of a picture, f a feature vector (C,) and phi the embedding of the kernel. This is the squared maximum
    mean discrepancy (MMD) in units of the style's own kernel: 0 for the same style, and rarely above 2. A portrait and
    a painting of stars, in the same colours, are 0.08 (poly), 0.09 (gaussian), 0.16 (linear) and 0.19 (meanstd) apart
    at 256 pixels.

    Source: Gatys et al. (2016) for poly; Li et al. (2017), "Demystifying neural style transfer", arXiv:1701.01036, for
    the others (meanstd is their matching of batch norm statistics); Rahimi and Recht (2007) for the random Fourier
    features; thesis 2020, eq. 6.38: sum of w_l / (4 N^2 M^2) |G - A|^2. Unlike in the thesis, sums over positions are
    replaced by means, and 1 / (4 N^2) and w_l by the magnitude of the style itself, so that all taps have equal weight.

    Statistics cover the whole picture even if a step works on a part of it: they are the sums over the canvas as last
    painted, minus the part's old sums, plus its current sums. They ignore the focus.

    Args:
        weight: factor in the sum of losses. With ``mse`` at a weight of 1 (``style.content=1``), 0.1 gives a photograph
            with a trace of the style, 1 a painting with a clear subject, and 10 a painting whose subject can be
            guessed.
        image: style picture, given as a path or the name of a sample; null uses the target itself.
        kernel: statistics to compare: poly (f f^T, the Gram matrix), linear (means of channels), gaussian (256 waves
            sqrt(2/D) cos(W f + b), with the median distance of the style's positions as bandwidth) or meanstd (means
            and standard deviations).
        backbone: feature network: effl0, or vgg16, which needs ``weights``.
        weights: file with the network's weights; null uses those of its package.
        taps: activations to compare; null or [] uses stem, b0, b2 and b4 of effl0, or relu1_1 to relu4_1 of VGG16.
        scale: longer side of the style picture relative to that of the canvas; smaller values make its strokes finer.
            Neither side may be shorter than the context of the network (32 pixels for effl0).
        colors: source of the colours: style keeps the colours of the style picture; content first maps them to the
            target's colours.
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
        rows = (row for row in STYLE_TAPS if set(row) <= set(self.network.taps))
        self.taps = list(taps or next(rows, self.network.default_taps))
        self.network.check(self.taps)
        self.context, self.grid = self.network.context, self.network.grid
        self._surroundings: Surroundings | None = None  # surroundings of the last step; None for the whole canvas
        self._canvas = torch.empty(0)  # (3, H, W) picture of the sums below
        self._rest: list[Tensor] = []  # sums over the canvas without the current part

    def check(self, size: tuple[int, int]) -> int:
        """Return the style picture's longer side in pixels; raise a UserError if the network needs a larger picture."""
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
    def measure(self, picture: Tensor, target: Tensor) -> dict[str, float]:
        every = {kernel: self._styles(target, kernel) for kernel in KERNELS}
        return {kernel: float(_distance(styles, self._tiled_sums(styles, picture))) for kernel, styles in every.items()}

    def _styles(self, target: Tensor, kernel: str) -> list[TapStyle]:
        def compute(target: Tensor) -> list[TapStyle]:
            picture, styles = self.picture(target), []
            tiles = self.network.activations_by_tile(picture, self.taps)
            statistics = ([_sample_and_power(features, kernel) for features in tile] for tile in tiles)
            for samples, powers, counts in (zip(*parts, strict=True) for parts in zip(*statistics, strict=True)):
                unit = max(sum(powers) / sum(counts), MIN_FEATURE_POWER)
                styles.append(TapStyle(kernel, KERNELS[kernel].embedding(torch.cat(samples, 1)), unit))
            sums = self._tiled_sums(styles, picture)
            return [style._replace(mean=total[1:] / total[0]) for style, total in zip(styles, sums, strict=True)]

        return self.of_target(target, compute, kernel)

    @torch.no_grad()
    def _turn_to(self, around: Surroundings, styles: list[TapStyle]) -> None:
        """Compute the sums over the canvas minus the sums over the region in which the next steps work."""
        last = self._surroundings
        if last is None or last.picture is not around.picture or last.target is not around.target:
            self._canvas = around.picture.clone()
            whole = self._tiled_sums(styles, self._canvas)
        else:  # only the region of the last steps has changed; `forward` adds the current region
            core = last.core or last.region
            core.of(self._canvas).copy_(core.of(around.picture))
            changed = self._sums(styles, last.region.of(self._canvas))
            whole = [rest + part for rest, part in zip(self._rest, changed, strict=True)]
        part = self._sums(styles, around.region.of(self._canvas))
        self._rest = [a - b for a, b in zip(whole, part, strict=True)]
        self._surroundings = around

    def _sums(self, styles: list[TapStyle], picture: Tensor) -> list[Tensor]:
        features = self.network(picture[None], self.taps)
        return [style.sums(features[tap][0].flatten(1)) for style, tap in zip(styles, self.taps, strict=True)]

    def _tiled_sums(self, styles: list[TapStyle], picture: Tensor) -> list[Tensor]:
        """Compute the `_sums` of a picture of any size, using only as much memory as a single tile needs."""
        tiles = self.network.activations_by_tile(picture, self.taps)
        sums = ([style.sums(part) for style, part in zip(styles, tile, strict=True)] for tile in tiles)
        return [torch.stack(parts).sum(0) for parts in zip(*sums, strict=True)]


def _distance(styles: list[TapStyle], sums: list[Tensor]) -> Tensor:
    return torch.stack([style.discrepancy(total) for style, total in zip(styles, sums, strict=True)]).mean()


def _sample_and_power(features: Tensor, kernel: str) -> tuple[Tensor, float, int]:
    """Return features (C, P) at some positions, the sum of k(f, f) over all positions, and the number of positions."""
    step = max(1, features.shape[1] // BANDWIDTH_POSITIONS)
    return features[:, ::step], float(KERNELS[kernel].power(features.double())), features.shape[1]
