"""The ``evolution`` painter: a genetic algorithm whose population is the painting."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp.contracts.pictures import sample_at
from brushexp.contracts.strokes import Strokes
from brushexp_painters._laying import PORTIONS, Array, numpy_generator, strokes_from_arrays, vectors
from brushexp_painters.greedy import LARGEST_CANDIDATE, SMALLEST_CANDIDATE, worst_places

LEAST_HALF = 0.5  # smallest half-thickness in pixels
MARGIN = 1.5  # width in pixels of a margin that contains a stroke's soft edge
SIDES = (2.5, 6.0)  # range of a cell's side, in units of the reach of a random stroke
SUCCESS_RATE = 0.2  # share of surviving children at which mutations keep their size (Rechenberg, 1973)
STEP_RANGE = (0.01, 0.5)  # range of mutation sizes: shape in stroke lengths, colour in shares of its range


@dataclass(frozen=True)
class Genes:
    """The genes of N strokes, in any order."""

    middle: Array  # (N, 2) in pixels
    along: Array  # (N, 2) vector from the middle to the end
    bend: Array  # (N,) offset of the control point perpendicular to ``along``, in lengths of ``along``
    half: Array  # (N,) half of the thickness in pixels
    color: Array  # (N, 3)
    depth: Array  # (N,) from the bottom up

    def __getitem__(self, index: Array) -> "Genes":
        return Genes(*(getattr(self, gene.name)[index] for gene in fields(Genes)))

    def replace(self, index: Array, others: "Genes") -> "Genes":
        """Return a copy in which ``others`` replace the genes at ``index``."""
        result = Genes(*(getattr(self, gene.name).copy() for gene in fields(Genes)))
        for gene in fields(Genes):
            getattr(result, gene.name)[index] = getattr(others, gene.name)
        return result

    @property
    def reach(self) -> Array:
        """Upper bound (N,) on the distance from a stroke's middle to its farthest point."""
        return np.hypot(*self.along.T) * np.hypot(1, self.bend) + self.half + MARGIN

    def strokes(self, opacity: float) -> Strokes:
        """Convert the genes to strokes, bottom to top."""
        across = np.stack([-self.along[:, 1], self.along[:, 0]], 1) * self.bend[:, None]
        curves = np.stack([self.middle - self.along, self.middle + across, self.middle + self.along], 1)
        order = np.argsort(self.depth, kind="stable")
        return strokes_from_arrays(curves[order], 2 * self.half[order], self.color[order], opacity)


@register("painter", "evolution")
@dataclass(kw_only=True)
class Evolution(Painter):
    """A genetic algorithm that starts from random strokes; a child replaces its parent if it lowers the error.

    Source: the genetic algorithms in section 5.3 of the thesis, in the manner of Collet et al., 2000 (Polar IFS +
    Parisian Genetic Programming): the painting is the whole population, not one of its members. This amounts to
    Haeberli's relaxation (1990) with crossover. A child is its parent with some genes mutated or taken from another
    stroke, or a new stroke on top where the error is large. The size of mutations follows the one-fifth rule
    (Rechenberg, 1973).

    Unlike in the sources, the canvas is divided into cells whose size and position change with each generation. In each
    cell, one of the strokes inside it has a child, and all children are evaluated in one picture, cell by cell. Initial
    colours are taken from the picture.

    Args:
        children: number of children evaluated per stroke.
        crossover: fraction of the children that inherit genes from another stroke.
        renewal: fraction of the generations whose children are new strokes.
        opacity: fraction of the paint below that a stroke hides, up to 1.
    """

    kind = "trial and error"

    children: Annotated[int, at_least(1)] = 40
    crossover: Annotated[float, between(0, 1)] = 0.1
    renewal: Annotated[float, between(0, 1)] = 0.3
    opacity: Annotated[float, between(0.01, 1)] = 0.9

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        random = numpy_generator(request.generator)
        target = request.target.cpu().permute(1, 2, 0).contiguous().numpy()
        genes, step = initial_genes(request, target, random), STEP_RANGE[1]
        canvas, judged, portion = self._draw(request, genes), 0, 0
        due = self.children * request.n
        while judged < due:
            cells = Cells(request.size, genes, random)
            parents, children, are_mutants = self._children(genes, cells, target, canvas, step, random)
            picture = self._draw(request, genes.replace(parents, children))
            place = cells.of(children.middle)
            lives = (cells.errors(target - picture) < cells.errors(target - canvas))[place]
            genes = genes.replace(parents[lives], children[lives])
            canvas = np.where(np.isin(cells.of_pixels, place[lives])[..., None], picture, canvas)
            if are_mutants.any():
                step = float(np.clip(step * np.exp(lives[are_mutants].mean() - SUCCESS_RATE), *STEP_RANGE))
            judged = min(judged + max(1, len(parents)), due)
            if judged * PORTIONS // due > portion:
                portion = judged * PORTIONS // due
                yield PaintState(genes.strokes(self.opacity), judged, due)

    def _draw(self, request: PaintRequest, genes: Genes) -> Array:
        strokes = genes.strokes(self.opacity).map(lambda value: value.to(request.target))
        return request.draw(strokes).cpu().permute(1, 2, 0).numpy()

    def _children(
        self, genes: Genes, cells: "Cells", target: Array, canvas: Array, step: float, random: np.random.Generator
    ) -> tuple[Array, Genes, Array]:
        """Choose parents and make a child of each; return parents, children, and a mask that marks mutants.

        Children that do not fit into their parent's cell are dropped, together with the parent.
        """
        parents = cells.choose_one_each(genes, random)
        if random.random() < self.renewal:
            places = worst_places(target, canvas, random)
            _, chosen, at = np.intersect1d(cells.of(genes.middle[parents]), cells.of(places), return_indices=True)
            parents, middle = parents[chosen], places[at]
            length = np.exp(random.uniform(0, np.log(cells.room(middle).clip(1.5, None))))
            depth = genes.depth.max() + 1 + np.arange(len(parents))
            children, are_mutants = random_genes(middle, length, target, depth, random), np.zeros(len(parents), bool)
        else:
            are_mutants = random.random(len(parents)) >= self.crossover
            others = genes[random.integers(len(genes.half), size=len(parents))]
            children = vary(genes[parents], others, are_mutants, step, random)
        fits = (cells.room(children.middle) >= children.reach) & (
            cells.of(children.middle) == cells.of(genes.middle[parents])
        )
        return parents[fits], children[fits], are_mutants[fits]


def vary(own: Genes, others: Genes, mutate: Array, step: float, random: np.random.Generator) -> Genes:
    """Change each gene with probability 1/2: mutate it if ``mutate`` (n,) is true, else copy it from ``others``."""
    n, length = len(mutate), np.hypot(*own.along.T) + own.half
    sizes = {"middle": length, "along": length, "bend": np.ones(n), "half": 0.5 * length, "color": np.full(n, 0.5)}
    genes = {}
    for name, size in sizes.items():
        value = getattr(own, name)
        wide = (n, *[1] * (value.ndim - 1))
        mutant, change = mutate.reshape(wide), random.random(wide) < 0.5
        other = value if name == "middle" else getattr(others, name)
        child = np.where(mutant, value + step * size.reshape(wide) * random.standard_normal(value.shape), other)
        genes[name] = np.where(change, child, value)
    genes["half"], genes["color"] = genes["half"].clip(LEAST_HALF, None), genes["color"].clip(0, 1)
    return Genes(**genes, depth=own.depth)


def initial_genes(request: PaintRequest, target: Array, random: np.random.Generator) -> Genes:
    """Sample random strokes, with small ones on top of large ones."""
    n, smallest = request.n, SMALLEST_CANDIDATE * request.pitch
    middle = random.uniform(0, 1, (n, 2)) * request.size[::-1]
    low, high = np.log(smallest), np.log(max(LARGEST_CANDIDATE * min(request.size), smallest))
    length = np.sort(np.exp(random.uniform(low, high, n)))[::-1]
    return random_genes(middle, length, target, np.arange(n, dtype=float), random)


def random_genes(middle: Array, length: Array, target: Array, depth: Array, random: np.random.Generator) -> Genes:
    """Sample strokes at positions (n, 2) with half-lengths (n,), the target's colours and random directions."""
    n = len(length)
    along = vectors(length, random.uniform(0, np.pi, n))
    half = (length * random.uniform(0.2, 0.7, n)).clip(LEAST_HALF, None)
    color = sample_at(target.transpose(2, 0, 1), *middle.T).T
    return Genes(middle, along, random.normal(0, 0.25, n), half, color, depth)


class Cells:
    """A grid of square cells, with random size and offset, that extends beyond the canvas."""

    def __init__(self, size: tuple[int, int], genes: Genes, random: np.random.Generator) -> None:
        height, width = size
        self.side = float(random.choice(genes.reach) * random.uniform(*SIDES))
        self.columns = int(2 * max(size) / self.side) + 4
        self.shift = self.columns * self.side / 4 + random.uniform(0, self.side, 2)
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        self.of_pixels = self.of(np.stack([x, y], 2))  # (H, W)

    def of(self, place: Array) -> Array:
        """Return the cell index (...) of each position (..., 2); border cells include positions far off the canvas."""
        index = ((place + self.shift) / self.side).clip(0, self.columns - 1).astype(int)
        return index[..., 1] * self.columns + index[..., 0]

    def room(self, place: Array) -> Array:
        """Compute the distance (n,) from positions (n, 2) to the nearest border of their cells."""
        inside = (place + self.shift) % self.side
        return np.minimum(inside, self.side - inside).min(1)

    def errors(self, difference: Array) -> Array:
        """Sum the squared values of a difference picture (H, W, 3) in each cell."""
        return np.bincount(self.of_pixels.ravel(), np.square(difference).sum(2).ravel(), self.columns**2)

    def choose_one_each(self, genes: Genes, random: np.random.Generator) -> Array:
        """Choose a random stroke among those completely inside each cell, if there are any; return the indices."""
        index = random.permutation(np.flatnonzero(self.room(genes.middle) >= genes.reach))
        return index[np.unique(self.of(genes.middle[index]), return_index=True)[1]]
