"""Hold the parameters of strokes during optimisation, with their units and bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import accumulate
from numbers import Integral

import torch
from torch import Tensor, nn, optim

from brushexp.errors import UserError


@dataclass(frozen=True)
class Field:
    """The shape, unit and range of one field of a stroke."""

    size: int  # numbers per stroke; 0 means a plain (N,) tensor
    low: float
    high: float
    unit: str

    def shape(self, n: int) -> tuple[int, ...]:
        return (n, self.size) if self.size else (n,)

    def nearest(self, value: Tensor) -> Tensor:
        """Clamp values to the range; a NaN becomes 0 or the nearest bound."""
        return value.nan_to_num(0.0).clamp_(self.low, self.high)


PRECISE = (torch.float32, torch.float64)  # precisions in which strokes are optimised and drawn
FARTHEST_POSITION = 1e6  # pixels; float32 coordinates beyond this are coarser than a tenth of a pixel
BRUSH_COUNT = 2**31  # number of brushes that fit into 32 bits, as in files
FIELDS = {
    "position": Field(2, -FARTHEST_POSITION, FARTHEST_POSITION, "centre of the window, pixels, x right, y down"),
    "scale": Field(0, 1e-3, FARTHEST_POSITION, "side of the stroke's window in pixels"),
    "start": Field(2, -1e3, 1e3, "half-windows from position"),
    "control": Field(2, -1e3, 1e3, "half-windows from position"),
    "end": Field(2, -1e3, 1e3, "half-windows from position"),
    "width": Field(0, 0.0, 1e3, "full thickness as a fraction of the window's side"),
    "color": Field(3, 0.0, 1.0, "display-referred (sRGB) red, green, blue"),
    "opacity": Field(0, 0.0, 1.0, "1 covers what lies below"),
    "softness": Field(0, 0.0, 1e3, "width of the edge, beyond the renderer's own, as a fraction of the window's side"),
    "widening": Field(0, -1.0, 1.0, "growth of the thickness from the middle to the end; the start shrinks as much"),
    "drift": Field(3, -0.5, 0.5, "colour at the end less that in the middle; the start differs as much the other way"),
}
LATER_FIELDS = {"softness": 3, "widening": 3, "drift": 4}  # first version of catalogues that has the field
SCALE_FIRST = sorted(FIELDS, key=lambda name: name != "scale")  # scale is the unit of position


@dataclass(frozen=True)
class Strokes:
    """N strokes as tensors of one dtype on one device; see ``FIELDS`` for units and ranges. Pixel centres lie at +0.5.

    In renderers with several textures, ``brush`` determines a stroke's texture; it stays the same when other strokes
    are added or removed. Few renderers draw `LATER_FIELDS`; optimisers do not change these fields unless ``units``
    lists them.

    >>> import torch
    >>> level = Strokes(
    ...     position=torch.tensor([[20.0, 10.0]]), scale=torch.tensor([16.0]), start=torch.tensor([[-0.5, 0.0]]),
    ...     control=torch.zeros(1, 2), end=torch.tensor([[0.5, 0.0]]), width=torch.tensor([0.25]),
    ...     color=torch.tensor([[1.0, 0.0, 0.0]]), opacity=torch.ones(1),
    ... )
    >>> check_strokes(level)
    >>> both = Strokes.join(level, level.moved(zoom=2.0))
    >>> len(both), (both.width * both.scale).tolist()  # thickness in pixels
    (2, [4.0, 8.0])
    """

    position: Tensor  # (N, 2)
    scale: Tensor  # (N,)
    start: Tensor  # (N, 2) first point of a quadratic Bezier curve
    control: Tensor  # (N, 2)
    end: Tensor  # (N, 2)
    width: Tensor  # (N,)
    color: Tensor  # (N, 3)
    opacity: Tensor  # (N,)
    softness: Tensor = None  # type: ignore[assignment]  # (N,) 0 if it is not given
    widening: Tensor = None  # type: ignore[assignment]  # (N,) 0 if it is not given
    drift: Tensor = None  # type: ignore[assignment]  # (N, 3) 0 if it is not given
    brush: Tensor = None  # type: ignore[assignment]  # (N,) int64, 0 or more

    def __post_init__(self) -> None:
        for name in LATER_FIELDS:
            if getattr(self, name) is None:
                object.__setattr__(self, name, torch.zeros_like(self.color if FIELDS[name].size else self.width))
        if self.brush is None:
            object.__setattr__(self, "brush", torch.arange(len(self), device=self.position.device))

    def __len__(self) -> int:
        return self.position.shape[0]

    def __getitem__(self, index: Tensor | slice | int) -> Strokes:
        """Select strokes by a slice, a mask (N,) or indices; a single index returns `Strokes` of length 1.

        >>> import torch
        >>> from brushexp.strokes.prior import sample_prior
        >>> strokes = sample_prior(3)
        >>> len(strokes[0]), len(strokes[1:]), torch.equal(strokes[-1].position, strokes.position[2:])
        (1, 2, True)
        """
        if isinstance(index, Integral):
            number = range(len(self))[int(index)]  # an IndexError, which ends loops over strokes
            index = slice(number, number + 1)
        return replace(self, brush=self.brush[index], **{name: value[index] for name, value in self.items()})

    def items(self) -> Iterator[tuple[str, Tensor]]:
        """Yield the name and tensor of each field in the order of ``FIELDS``."""
        return ((name, getattr(self, name)) for name in FIELDS)

    def map(self, function: Callable[[Tensor], Tensor]) -> Strokes:
        """Apply a function to each field; it may change dtype and device, but a change of N raises a UserError."""
        changed = {name: function(value) for name, value in self.items()}
        if (count := len(changed["position"])) != len(self):
            cure = "select strokes with strokes[:1], a mask or numbers"
            raise UserError(
                f"map must keep the number of strokes, {len(self)}, but the function returned {count}; {cure}"
            )
        return Strokes(**changed, brush=self.brush.to(changed["position"].device))

    @torch.no_grad()
    def clamp(self) -> Strokes:
        """Clamp all values to their ranges in place, for example after an optimiser step; a NaN becomes 0 or a bound.

        >>> import torch
        >>> from brushexp.strokes.prior import sample_prior
        >>> strokes = sample_prior(2).map(lambda value: value.requires_grad_())
        >>> (strokes.color.sum() + strokes.width.sum()).backward()
        >>> torch.optim.SGD([value for _, value in strokes.items()], lr=9.0).step()
        >>> strokes.clamp().color.tolist(), strokes.width.tolist()
        ([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [0.0, 0.0])
        """
        for name, field in FIELDS.items():
            value = getattr(self, name)
            value.copy_(field.nearest(value))
        return self

    def moved(self, zoom: float = 1.0, shift: tuple[float, float] = (0.0, 0.0)) -> Strokes:
        """Return the strokes scaled by ``zoom``, then moved by ``shift`` (x, y) pixels."""
        position = self.position * zoom + self.position.new_tensor(shift)
        return replace(self, position=position, scale=self.scale * zoom)

    def with_rows(self, rows: Tensor, others: Strokes) -> Strokes:
        """Return a copy with ``others`` in place of the strokes at ``rows``; each row keeps its brush."""
        return replace(self, **{name: value.index_copy(0, rows, getattr(others, name)) for name, value in self.items()})

    @staticmethod
    def join(*parts: Strokes) -> Strokes:
        """Concatenate strokes, adding the number of strokes in earlier parts to the brush numbers of each part."""
        before = accumulate((len(part) for part in parts), initial=0)
        brush = torch.cat([part.brush + count for part, count in zip(parts, before, strict=False)])
        return Strokes(**{name: torch.cat([getattr(part, name) for part in parts]) for name in FIELDS}, brush=brush)

    @staticmethod
    def none(like: Tensor | None = None) -> Strokes:
        """Make an empty set of strokes with the dtype and device of ``like``."""
        like = torch.empty(0) if like is None else like
        return Strokes(**{name: like.new_empty(field.shape(0)) for name, field in FIELDS.items()})


def check_strokes(strokes: Strokes) -> None:
    """Raise a UserError that names field and stroke if a shape is wrong or a value is not finite or out of range."""
    wrong = {}
    for name, field in FIELDS.items():
        value = getattr(strokes, name)
        if tuple(value.shape) != field.shape(len(strokes)):
            raise UserError(f"{name} has shape {tuple(value.shape)}; {field.shape(len(strokes))} is needed")
        wrong[name] = ~(value.isfinite() & (value >= field.low) & (value <= field.high))
    found = torch.stack([numbers.any() for numbers in wrong.values()]).tolist()  # waits for a GPU only once
    for name, field in [item for item, is_wrong in zip(FIELDS.items(), found, strict=True) if is_wrong]:
        index = int(wrong[name].reshape(len(strokes), -1).any(1).nonzero()[0])
        number = getattr(strokes, name)[index].detach().reshape(-1).tolist()
        cure = f"it must lie in [{field.low:g}, {field.high:g}] ({field.unit})"
        raise UserError(f"stroke {index}: {name} is {', '.join(f'{x:g}' for x in number)}; {cure}")
    brush = strokes.brush
    beyond = (brush < 0) | (brush >= BRUSH_COUNT)
    if brush.shape != (len(strokes),) or brush.dtype != torch.int64 or bool(beyond.any()):
        needed = f"a whole number (int64) from 0 to {BRUSH_COUNT - 1} of each stroke"
        raise UserError(f"brush is not {needed}; correct it or leave it out")


def drawable(strokes: Strokes) -> Strokes:
    """Convert 16-bit strokes to float32 for renderers; gradients are converted back to 16 bits.

    Positions beyond the range of float16 (65,504 px) are infinite; they lie off any canvas and stay there. Other values
    that overflow 16 bits, and integer or complex strokes, raise a UserError.
    """
    dtype = strokes.position.dtype
    if dtype in PRECISE:
        return strokes
    if dtype not in (torch.float16, torch.bfloat16):
        raise UserError(f"strokes are {dtype}; convert them with strokes.map(lambda value: value.float())")
    if dtype == torch.float16:
        position = strokes.position.float().nan_to_num(torch.nan, FARTHEST_POSITION, -FARTHEST_POSITION)
        strokes = replace(strokes, position=position)
    try:
        check_strokes(strokes)
    except UserError as error:
        raise UserError(f"{error}; {dtype} may be too narrow for these strokes: make them in float32") from error
    return strokes.map(Tensor.float)


def check_units(units: Mapping[str, float]) -> None:
    """Raise a UserError if a unit belongs to an unknown field, or if position and scale would both move."""
    if unknown := sorted(set(units) - set(FIELDS)):
        raise UserError(f"no stroke field is called {unknown[0]!r}; the fields are {', '.join(FIELDS)}")
    if units.get("scale") and units.get("position"):
        raise UserError("scale is the unit of position, so only one of them can move; set the rate of scale to 0")


class Catalogue(nn.Module):
    """A module that owns strokes as parameters, keeps them finite and in range, and adds and removes strokes.

    An optimiser sees each field divided by its unit, so that one learning rate serves all fields: with Adam, a step at
    ``lr`` moves a field by about ``lr * unit``. The unit of ``position`` is measured in half-windows of each stroke. A
    field is frozen if its unit is 0 or missing.
    """

    scale: Tensor
    brush: Tensor

    def __init__(self, strokes: Strokes, units: Mapping[str, float]) -> None:
        super().__init__()
        if strokes.position.dtype not in PRECISE:
            cure = "optimise them as strokes.map(lambda value: value.float())"
            raise UserError(f"strokes are {strokes.position.dtype}, in which small steps are lost; {cure}")
        check_units(units)
        self.units = {name: float(units.get(name, 0.0)) for name in FIELDS}
        self._store(strokes)

    def forward(self) -> Strokes:
        """Return the current strokes, which are differentiable with respect to the parameters."""
        return Strokes(**{name: getattr(self, name) * self._unit(name) for name in FIELDS}, brush=self.brush)

    def __len__(self) -> int:
        return len(self.scale)

    def is_finite(self) -> bool:
        """Check whether all parameters are finite by summing them, which is faster than `isfinite`."""
        sums = [value.detach().sum(dtype=torch.float64) for value in self.parameters()]
        return not sums or bool(torch.stack(sums).isfinite().all())  # waits for a GPU only once

    @torch.no_grad()
    def keep_in_range(self) -> None:
        """Clamp every moving field to its range; a NaN becomes 0 or the nearest bound."""
        for name, field in FIELDS.items():
            if self.units[name]:
                value, unit = getattr(self, name), self._unit(name)
                value.copy_(field.nearest(value * unit) / unit)

    @torch.no_grad()
    def replace(self, strokes: Strokes) -> None:
        """Write new values for the same strokes into the existing parameters, which an optimiser may hold."""
        before = self()
        for name in SCALE_FIRST:
            value = getattr(strokes, name)
            if name == "position" or not torch.equal(value, getattr(before, name)):
                getattr(self, name).copy_(value / self._unit(name))

    @torch.no_grad()
    def part(self, rows: Tensor) -> Catalogue:
        """Copy the strokes at ``rows`` (A,) into a separate catalogue."""
        part = Catalogue(self()[rows], self.units)
        for name in FIELDS:  # copies bits, because a field is its parameter times its unit, which rounds
            getattr(part, name).copy_(getattr(self, name)[rows])
        return part

    @torch.no_grad()
    def put(self, rows: Tensor, part: Catalogue) -> None:
        """Write a changed copy of the strokes at ``rows``, made by `part`, back into this catalogue."""
        for name in FIELDS:
            getattr(self, name)[rows] = getattr(part, name)

    @torch.no_grad()
    def revise(self, keep: Tensor, new: Strokes, optimizer: optim.Optimizer | None = None) -> None:
        """Drop strokes where ``keep`` (N,) is false, and append ``new`` strokes; kept strokes retain optimiser state.

        Only state that consists of counters and one number per parameter is retained; other state, such as the history
        of L-BFGS, is reset.
        """
        before = {id(getattr(self, name)): name for name in FIELDS}
        self._store(Strokes.join(self()[keep], new))
        if optimizer is None:
            return
        for group in optimizer.param_groups:
            group["params"] = [getattr(self, before[id(old)]) for old in group["params"]]
        for old in [old for old in optimizer.state if id(old) in before]:
            state = optimizer.state.pop(old)
            if all(torch.is_tensor(value) and value.shape in ((), old.shape) for value in state.values()):
                parameter = getattr(self, before[id(old)])
                optimizer.state[parameter] = {key: _carry(value, keep, parameter) for key, value in state.items()}

    def resize(self, n: int) -> None:
        """Resize the catalogue to ``n`` blank strokes, so that a state with ``n`` strokes can be loaded."""
        if n != len(self):
            blank = {name: self.scale.new_full(field.shape(n), max(field.low, 0)) for name, field in FIELDS.items()}
            self._store(Strokes(**blank))

    def _unit(self, name: str) -> Tensor | float:
        unit = self.units[name] or 1.0
        return 0.5 * unit * self.scale[:, None] if name == "position" and self.units[name] else unit

    def _store(self, strokes: Strokes) -> None:
        """Store strokes, with moving fields as parameters and all others as buffers."""
        check_strokes(strokes)
        self.register_buffer("brush", strokes.brush.clone())
        for name in SCALE_FIRST:
            value = getattr(strokes, name).detach().clone()
            if hasattr(self, name):
                delattr(self, name)
            if self.units[name]:
                self.register_parameter(name, nn.Parameter(value / self._unit(name)))
            else:
                self.register_buffer(name, value)


def _carry(value: Tensor, keep: Tensor, parameter: Tensor) -> Tensor:
    """Carry over the optimiser state of the remaining strokes, with zeros for new ones; counters do not change."""
    if value.ndim == 0:
        return value
    carried = value.new_zeros(parameter.shape)
    carried[: int(keep.sum())] = value[keep]
    return carried
