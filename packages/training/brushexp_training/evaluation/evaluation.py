"""Assess a renderer's pictures by per-stroke errors, distances between sets of pictures, and contact sheets."""

import math
import warnings
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import lightning as L
import torch
from skimage.util import montage
from torch import Tensor, nn
from torch.nn import functional
from torchmetrics.image.fid import FrechetInceptionDistance
from torchmetrics.image.kid import KernelInceptionDistance

from brushexp.contracts import UserError
from brushexp.contracts.files import write_picture
from brushexp.contracts.pictures import open_backbone, psnr_of
from brushexp.contracts.strokes import strokes_of

TAP, TAP_CHANNELS = "b10", 112  # an activation of effl0; with more features than pictures, an FID is meaningless
INCEPTION_FEATURES = 2048
LEAST_SIDE = 128  # pixels; smaller pictures are enlarged for effl0, whose activation is 16 times coarser
SHEET_SIDE = 128  # pixels to which a sheet's pictures are magnified, as far as integer factors allow
GAP_PIXELS, GAP_LEVEL = 4, 0.88  # width and grey level of the gaps between pictures
KID_PICTURES = 5000  # maximum number of pictures compared with each other; memory grows quadratically
DETAIL_REACH = 2  # pixels to each side of the mean that is subtracted to leave detail
INSIDE = 0.25  # covered share of the surroundings above which a pixel is inside a stroke
THICK = 0.1  # thickness in windows above which strokes count as thick
ROUNDING = 0.51 / 255  # maximum error of pictures stored in 8 bits
SMALLEST_SET = 64  # smallest number of strokes for which distances by number are reported
SHEET_PAIRS, PAIR_COLUMNS = 24, 6  # held-out strokes per sheet and per row

_backbone_of = cache(open_backbone)
Features = Callable[[Tensor], Tensor]  # pictures (n, 3, H, W) in [0, 1] -> (n, F)


def premultiply(images: Tensor) -> Tensor:
    """Premultiply RGBA pictures (..., 4, H, W) by alpha, so that colour errors weigh as much as in a painting."""
    color, alpha = images.split([3, 1], dim=-3)
    return torch.cat([color * alpha, alpha], dim=-3)


def squared_error(images: Tensor, truth: Tensor) -> Tensor:
    """Compute the L2 error of pictures (..., 4, H, W).

    This is the mean squared difference over the four premultiplied channels.
    """
    return (premultiply(images) - premultiply(truth)).square().mean()


def fine_detail(planes: Tensor) -> Tensor:
    """Subtract the local mean over 5 x 5 pixels from planes (..., H, W).

    In windows of 64 pixels, this leaves the traces of the bristles.
    """
    with torch.autocast(planes.device.type, enabled=False):  # 16 bits would lose small differences
        rows, columns = (_mean_of_five(side, planes) for side in planes.shape[-2:])
        return planes - rows @ planes @ columns.T


def _mean_of_five(side: int, like: Tensor) -> Tensor:
    """Return the matrix (side, side) that computes a moving average over five values.

    Multiplying by it takes a tenth of the time of avg_pool2d.
    """
    line = torch.arange(side, device=like.device)
    near = ((line[:, None] - line).abs() <= DETAIL_REACH).to(like.dtype)
    return near / near.sum(1, keepdim=True)


@torch.no_grad()
def error_sums(images: Tensor, truth: Tensor) -> Tensor:
    """Compute five additive sums (5,) over pictures (n, 4, S, S), RGBA with straight alpha.

    These are the number of pixels; the squared error of the four premultiplied channels (averaged over channels); the
    squared error of alpha; the true alpha; and the squared error of the straight colour (averaged over R, G and B)
    times the true alpha.
    """
    images, truth = images.double(), truth.double()
    paint, squared = truth[:, 3], (premultiply(images) - premultiply(truth)).square().mean(1)
    alpha, color = (images[:, 3] - paint).square(), (images[:, :3] - truth[:, :3]).square().mean(1) * paint
    return torch.stack([torch.ones_like(paint), squared, alpha, paint, color]).flatten(1).sum(1).cpu()


def error_figures(sums: Tensor) -> dict[str, float]:
    """Compute ``l2``, ``psnr_alpha`` (dB, all pixels) and ``psnr_color`` (dB, weighted by alpha) from `error_sums`."""
    pixels, squared, alpha, paint, color = sums.tolist()
    psnr_color = psnr_of(color / paint) if paint else math.nan
    return {"l2": squared / pixels, "psnr_alpha": psnr_of(alpha / pixels), "psnr_color": psnr_color}


@torch.no_grad()
def bristle_sums(images: Tensor, truth: Tensor, parameters: Tensor) -> Tensor:
    """Sum the energy of the fine detail in pictures (n, 4, S, S) of strokes (n, 10).

    The axes of the result (2, 2, 2) are thin or thick strokes, alpha or light, and drawn or true pictures. The energy
    is the square of `fine_detail` where more than a quarter of the surrounding 5 x 5 pixels is covered. A stroke is
    thick if it is at least `THICK` windows wide. Light is the brightness of the paint relative to the stroke's colour,
    weighted by the true alpha; it is 0 for strokes whose light is too faint for 8 bits.
    """
    paint, plain = truth[:, 3:], 0.5 * (parameters[:, 7:, None, None] + 1)
    inside = functional.avg_pool2d(paint, 5, 1, 2) > INSIDE
    thick = strokes_of(parameters).width >= THICK
    lit = ((truth[:, :3] - plain).abs() * (paint > 0) > ROUNDING).flatten(1).any(1)[:, None, None, None]
    energies = torch.zeros(2, 2, 2, dtype=torch.float64)
    for k, pictures in enumerate((images, truth)):
        light = lit * paint * (pictures[:, :3] - plain).mean(1, keepdim=True)
        for j, plane in enumerate((pictures[:, 3:], light)):
            energy = (inside * fine_detail(plane).double().square()).flatten(1).sum(1)
            energies[0, j, k], energies[1, j, k] = energy[~thick].sum(), energy[thick].sum()
    return energies


def bristle_figures(energies: Tensor) -> dict[str, float]:
    """Compute the ratios between drawn and true energies from `bristle_sums`.

    The keys are ``bristles_thin``, ``bristles_thick``, ``light_thin`` and ``light_thick``.
    """
    drawn, true = energies.unbind(-1)
    shares = (drawn / true).T.flatten().tolist()  # NaN without such strokes or light
    return dict(zip(("bristles_thin", "bristles_thick", "light_thin", "light_thick"), shares, strict=True))


class FeatureDistance:
    """FID and KID between drawn and true strokes on white, computed from ``count`` features of each picture.

    FID is the Frechet distance between two normal distributions of features (Heusel et al., 2017, arXiv:1706.08500).
    KID is the squared maximum mean discrepancy with the cubic kernel (Binkowski et al., 2018, arXiv:1801.01401), here
    over all pictures at once instead of random subsets, which makes it reproducible. Both depend on the number of
    pictures n, which should be reported with them. With the features "effl0", they are not comparable with published
    FIDs or KIDs.
    """

    def __init__(self, name: str, features: Features, count: int) -> None:
        self.name, self.features = name, features
        ready = nn.Identity()  # torchmetrics requires a network, but features are already computed
        ready.num_features = count  # type: ignore[assignment]
        self.fid = FrechetInceptionDistance(feature=ready)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # it warns about keeping all features, which are few
            self.kid = KernelInceptionDistance(feature=ready, subsets=1)

    def add(self, images: Tensor, truth: Tensor) -> None:
        """Add drawn and true pictures (n, 4, S, S), RGBA in [0, 1] with straight alpha."""
        self.compare(*(self.features(over_white(pictures)).double().cpu() for pictures in (images, truth)))

    def compare(self, drawn: Tensor, true: Tensor) -> None:
        """Add the features (n, count) of n drawn strokes and of n true strokes."""
        for features, real in ((drawn, False), (true, True)):
            self.fid.update(features, real=real)
            self.kid.update(features, real=real)

    def figures(self) -> dict[str, float]:
        """Compute ``fid_<name>`` and ``kid_<name>``, which are NaN for fewer than two strokes."""
        count = int(self.fid.real_features_num_samples)
        self.kid.subset_size = min(count, KID_PICTURES)
        fid, kid = (float(self.fid.compute()), float(self.kid.compute()[0])) if count > 1 else (math.nan, math.nan)
        return {f"fid_{self.name}": fid, f"kid_{self.name}": kid}

    def by_number(self) -> list[dict[str, object]]:
        """Tabulate FID and KID for sets of 64, 128, 256, ... strokes.

        A row has ``n``; the number of disjoint ``sets`` of n strokes; the mean and standard deviation of the distances
        over these sets; and the bias, which is the mean FID between successive sets of true strokes.
        """
        drawn, true = torch.cat(self.kid.fake_features), torch.cat(self.kid.real_features)
        rows: list[dict[str, object]] = []
        n = SMALLEST_SET
        while n <= len(drawn):
            parts = [part for part in zip(drawn.split(n), true.split(n), strict=True) if len(part[0]) == n]
            distances = [self._of(*part) for part in parts]
            bias = [self._of(a, b) for (_, a), (_, b) in pairwise(parts)]
            row: dict[str, object] = {"n": n, "sets": len(parts)}
            for key in distances[0]:
                values = torch.tensor([figures[key] for figures in distances], dtype=torch.float64)
                row |= {key: float(values.mean()), f"{key}_sd": float(values.std()) if len(values) > 1 else math.nan}
            key = f"fid_{self.name}"
            row[f"{key}_bias"] = sum(figures[key] for figures in bias) / len(bias) if bias else math.nan
            rows.append(row)
            n *= 2
        return rows

    def _of(self, drawn: Tensor, true: Tensor) -> dict[str, float]:
        other = FeatureDistance(self.name, self.features, drawn.shape[1])
        other.compare(drawn, true)
        return other.figures()


def effl0_distance(device: torch.device) -> FeatureDistance:
    """Return the `FeatureDistance` "effl0".

    It uses 112 channels of a packaged network, averaged over each picture.
    """
    network = _backbone_of("effl0").to(device)

    def features(pictures: Tensor) -> Tensor:
        zoom = max(1, -(-LEAST_SIDE // pictures.shape[-1]))
        large = functional.interpolate(pictures, scale_factor=zoom, mode="bilinear") if zoom > 1 else pictures
        return network(large, (TAP,))[TAP].mean((2, 3))

    return FeatureDistance("effl0", features, TAP_CHANNELS)


def inception_distance(path: Path, device: torch.device) -> FeatureDistance:
    """Return the `FeatureDistance` "inception", which uses the 2048 features of Inception v3, as published figures do.

    ``path`` is a TorchScript file such as inception-2015-12-05.pt from StyleGAN2-ADA; its network takes bytes (n, 3, H,
    W) and ``return_features=True``. An FID from fewer than 2048 strokes is too low. Raises UserError for other files.
    TorchScript is deprecated in torch; once it is removed (2.13 still has it), ``task=evaluate`` loses the key
    ``inception``.
    """
    if not path.is_file():
        raise UserError(f"inception={path}: there is no such file; give inception-2015-12-05.pt, or null")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            network = torch.jit.load(str(path), map_location=device).eval()

        def features(pictures: Tensor) -> Tensor:
            return network((pictures * 255 + 0.5).to(torch.uint8), return_features=True)

        shape = tuple(features(torch.zeros(1, 3, 64, 64, device=device)).shape)
    except (RuntimeError, ValueError, TypeError, AttributeError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise UserError(
            f"inception={path} is not Inception v3 as TorchScript ({reason}); give inception-2015-12-05.pt, or null"
        ) from error
    if shape != (1, INCEPTION_FEATURES):
        raise UserError(f"inception={path} returns features {shape}; give a network that returns (1, 2048)")
    return FeatureDistance("inception", features, INCEPTION_FEATURES)


def over_white(images: Tensor) -> Tensor:
    """Composite RGBA pictures (n, 4, H, W) with straight alpha over white; return (n, 3, H, W) in [0, 1]."""
    alpha = images[:, 3:]
    return (alpha * images[:, :3] + (1 - alpha)).clamp(0, 1)


def stroke_sheet(images: Tensor, columns: int) -> Tensor:
    """Arrange pictures in rows on a white sheet (3, height, width).

    The pictures (n, 4, H, W) are RGBA in [0, 1] with straight alpha.
    """
    zoom, columns = max(1, SHEET_SIDE // images.shape[-2]), min(columns, len(images))
    large = over_white(images).repeat_interleave(zoom, 2).repeat_interleave(zoom, 3).movedim(1, 3).cpu().numpy()
    layout = {"grid_shape": (-(-len(images) // columns), columns), "padding_width": GAP_PIXELS}
    return torch.from_numpy(montage(large, [GAP_LEVEL] * 3, channel_axis=3, **layout)).movedim(2, 0)


class HeldOutSheet(L.Callback):
    """Callback that writes, at every validation, a sheet of held-out strokes: the network's drawings and the true ones.

    The sheets are written to validation.png and pictures/epoch_XXX.png.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.pairs: list[Tensor] = []

    def on_validation_batch_end(self, trainer: L.Trainer, pl_module: Any, outputs: Any, batch: Any, *_: object) -> None:
        if sum(map(len, self.pairs)) < SHEET_PAIRS:
            self.pairs.append(torch.cat([outputs, batch.images], dim=3).cpu())

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        picture = stroke_sheet(torch.cat(self.pairs)[:SHEET_PAIRS], PAIR_COLUMNS)
        (self.folder / "pictures").mkdir(exist_ok=True)
        write_picture(self.folder / "pictures" / f"epoch_{trainer.current_epoch:03d}.png", picture)
        write_picture(self.folder / "validation.png", picture)


class FrechetDistance(L.Callback):
    """Callback that logs ``validation/fid_effl0`` at every validation, computed on the first ``n`` held-out strokes."""

    def __init__(self, n: int) -> None:
        self.n = n

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.remaining, self.distance = self.n, effl0_distance(pl_module.device)

    def on_validation_batch_end(self, trainer: L.Trainer, pl_module: Any, outputs: Any, batch: Any, *_: object) -> None:
        if self.remaining > 0:
            self.distance.add(outputs[: self.remaining].clamp(0, 1), batch.images[: self.remaining])
            self.remaining -= len(outputs)

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        pl_module.log("validation/fid_effl0", self.distance.figures()["fid_effl0"])
