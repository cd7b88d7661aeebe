"""Remove whole channels from a trained network, which makes it smaller and faster on any hardware."""

import warnings
from collections.abc import Iterable
from copy import deepcopy

import torch
from torch import Tensor, nn

from brushexp.contracts import UserError
from brushexp_training.evaluation.evaluation import squared_error
from brushexp_training.renderers.inverse_vgg import COARSEST, Coarsest, InverseVGG
from brushexp_training.stroke_sets.datamodule import StrokeBatch

MULTIPLE = 8  # widths stay multiples of this number of channels, which CPUs compute at once


def prune(renderer: InverseVGG, ratio: float, batches: Iterable[StrokeBatch]) -> InverseVGG:
    """Copy a network, leaving out the channels of each layer that affect its pictures least.

    ``ratio`` is the fraction of channels left out; the remaining widths are rounded to multiples of `MULTIPLE`.
    torch-pruning (Fang et al., 2023, arXiv:2301.12900) groups channels that are used together, and ranks them by how
    much, to first order, the loss on ``batches`` would change if their weights were set to 0 (Molchanov et al., 2019,
    arXiv:1906.10771). Raises UserError if torch-pruning is not installed, or if channels cannot be removed separately.
    """
    try:
        import torch_pruning  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise UserError("task=prune needs torch-pruning; pip install 'brushexp[prune]'") from error
    copy = deepcopy(renderer).eval().requires_grad_(True)
    if not ratio:
        return copy
    check_prunable(copy)
    spread = _Spread(copy.first)
    copy.first = spread  # type: ignore[assignment]
    for batch in batches:
        drawn = copy.draw(batch.parameters.to(spread.bias.device))
        squared_error(drawn, batch.images.to(drawn.device)).backward()
    loose = [(layer.strength, 0) for layer in copy.convolving if layer.strength is not None]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it warns about parameters passed to it
        torch_pruning.pruner.BasePruner(
            copy,
            torch.zeros(2, 10, device=spread.bias.device),
            forward_fn=lambda network, parameters: network.draw(parameters),
            importance=torch_pruning.importance.TaylorImportance(),
            pruning_ratio_dict=_ratios(copy, ratio),
            ignored_layers=[copy.last],
            unwrapped_parameters=[(spread.bias, 0), *loose],
            root_module_types=[nn.Conv2d, nn.ConvTranspose2d, nn.Linear],
        ).step()
    copy.first = spread.as_linear()
    copy.zero_grad(set_to_none=True)
    return copy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def check_prunable(renderer: nn.Module) -> None:
    """Raise UserError if single channels cannot be removed, or if no option can describe the remaining widths."""
    if not isinstance(renderer, InverseVGG):
        raise UserError(
            f"{type(renderer).__name__} has no option for the widths of its layers; use renderer=inverse_vgg"
        )
    kinds = {type(module) for module in renderer.modules()}
    if nn.GroupNorm in kinds:
        cure = "prune a renderer that was trained with renderer.normalisation=none or batch"
        raise UserError(f"renderer.normalisation=group or instance mixes channels in fixed groups; {cure}")
    if nn.PixelShuffle in kinds:
        cure = "prune a renderer that was trained with renderer.upsampling=nearest or bilinear"
        raise UserError(f"renderer.upsampling=pixel_shuffle ties channels to pixels; {cure}")


def _ratios(renderer: InverseVGG, ratio: float) -> dict[nn.Module, float]:
    """Compute the exact fraction of channels to remove from every layer but the last."""
    layers: dict[nn.Module, int] = {layer: len(layer.weight) for layer in renderer.dense}  # type: ignore[arg-type]
    layers[renderer.first.convolution] = renderer.first.convolution.out_channels  # type: ignore[index, union-attr, assignment]
    for layer in renderer.convolving:
        beside = [layer.convolution] if layer.coordinates is None else [layer.convolution, layer.coordinates]
        layers |= {module: module.out_channels for module in beside}  # type: ignore[union-attr, misc]
    remaining = {width: MULTIPLE * round(width * (1 - ratio) / MULTIPLE) for width in layers.values()}
    return {layer: 1 - (min(n, max(MULTIPLE, remaining[n])) + 0.5) / n for layer, n in layers.items()}


class _Spread(nn.Module):
    """`Coarsest` as a transposed convolution plus a bias, so that torch-pruning can identify its channels."""

    def __init__(self, layer: Coarsest) -> None:
        super().__init__()
        self.convolution = nn.ConvTranspose2d(layer.in_features, layer.channels, COARSEST, bias=False)
        self.convolution.to(layer.weight)
        with torch.no_grad():
            by_place = layer.weight.reshape(COARSEST, COARSEST, layer.channels, layer.in_features)
            self.convolution.weight.copy_(by_place.permute(3, 2, 0, 1))
            bias = layer.bias.reshape(COARSEST, COARSEST, layer.channels).permute(2, 0, 1)
        self.bias = nn.Parameter(bias.clone())

    def forward(self, x: Tensor) -> Tensor:
        return self.convolution(x[:, :, None, None]) + self.bias

    def as_linear(self) -> Coarsest:
        """Convert the layer back to `Coarsest`, with only the remaining channels."""
        weight = self.convolution.weight
        layer = Coarsest(len(weight), len(self.bias)).to(weight)
        with torch.no_grad():
            layer.weight.copy_(weight.permute(2, 3, 1, 0).flatten(0, 2))
            layer.bias.copy_(self.bias.permute(1, 2, 0).flatten())
        return layer
