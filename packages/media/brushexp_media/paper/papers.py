"""Papers and canvases as height maps, computed by formulas from position and therefore available at any size."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import above, at_least, between, register
from brushexp.contracts.families import Paper, Rows
from brushexp_media.paper.wetness import density_of_edges, displace_pixels, gather_pigment
from brushexp_media.picture.noise import LINE_REACH, draw_out, fractal_noise, gradient_noise, map_to_uniform
from brushexp_media.picture.smoothing import direction_of_edges, gaussian_blur, with_clean_edges

THOUSANDTHS, HUNDREDTHS = 1000, 100
WAVER, WAVES, FADE = 0.11, 0.25, 0.5  # border edge: deviation / width; longer sides per wave; fade in grains
PRESSURE, UNEVEN = 0.05, 4  # longer sides between areas of more and less hand pressure, and octaves below
STEEP = 2.2  # softness of the border of bare hollows: paint sets in over the share 1 / STEEP of heights
UNLIKE = 3.5  # hand pressure is full at 1 / UNLIKE of difference from the ground
PRESSED = 0.35  # additional share of the paper that the hand covers there, relative to no hollows at all
ACCENT = 6.0  # hand pressure is full at 1 / ACCENT of difference from the blurred picture
THICK = 5.0  # all pigment moves at 1 / THICK of difference from the ground
DEEPEST = 2.5  # standard deviations below the mean at which the relief of a paper begins
CRISP = 0.6  # scale in grains at which the directions of edges are determined
RIM = 1.5  # standard deviation, in grains, of the blur that defines edges
RUNS, RAN = 3.0, 1.5  # grains: distance that edges run on wet paper, and standard deviation of the blur there
WET, SOAKED = 0.2, 0.2  # longer sides between wet areas; share of the paper from dry to wet
SPARED, NEARBY = 4.0, 6.0  # extra dryness where there is detail; standard deviation of the neighbourhood in grains
HUES, COOLER = 0.15, (0.3, 0.0, -0.3)  # longer sides between hues of a wash; density of red, green, blue in cool areas
POOLED, POOLS = 3.0, 0.1  # all pigment settles at 1 / POOLED of darkness; longer sides between pools
GRANULATED = 0.35  # share of the granulation that every wash has, even between pools
LEFT = 0.5  # share of dusty paint that a hollow keeps
STREAK, HAND = 1.4, 2.5  # grains across a streak; standard deviation of the blur that sets the direction of streaks


@dataclass(kw_only=True, eq=False)
class GrainedPaper(Paper):
    """A paper with hollows that dry paint skips and in which wet pigment settles.

    Args:
        grain: size of the grain, in thousandths of the picture's longer side.
        tooth: fraction of the paper, its lowest hollows, that dry paint skips, 0 to 1.
        pressure: variation in the hand's pressure, 0 to 1, as a fraction of ``tooth``.
        dust: fraction of the paint that is dust, which half fills hollows, 0 (hollows have crisp borders) to 1.
        drag: elongation of the grain along the strokes, as if by a skipping stick, 0 to 1.
        accents: increase in the hand's pressure where there is detail, 0 to 1, so that small things cover the grain.
        roughness: height of the lit grain, in grain sizes; it has no effect if ``light.depth`` is 0.
        granulation: amount of wet pigment that settles in hollows, 0 to 2, largest where pigment pools in dark washes.
        rims: strength with which wet pigment gathers at the edges of a wash, 0 to 10.
        blooms: unevenness of washes due to drying, 0 to 2.
        clean: smoothing of paint along its edges, in grains, which gives many touches the edge of a single one.
        wander: distance by which wet edges are displaced, in grains.
        lost: fraction of the paper that is still wet when the next wash is laid, 0 to 1; edges run there.
        charged: variation in hue within a wash, towards warmer and cooler colours, 0 to 2.
        halftones: increase in the hand's pressure where paint is lighter or darker than the ground, 0 to 1, so that the
            ground serves as a halftone.
        frayed: width of the zone inside the border in which strokes fray out, in border widths, 0 to 10.
        border: width of the paper's bare border, in hundredths of the longer side.
        seed: seed of the grain.
    """

    grain: Annotated[float, above(0, 1000)] = 4.0
    tooth: Annotated[float, between(0, 1)] = 0.15
    pressure: Annotated[float, between(0, 1)] = 0.4
    dust: Annotated[float, between(0, 1)] = 0.0
    drag: Annotated[float, between(0, 1)] = 0.0
    accents: Annotated[float, between(0, 1)] = 0.0
    roughness: Annotated[float, between(0, 10)] = 0.15
    granulation: Annotated[float, between(0, 2)] = 0.0
    rims: Annotated[float, between(0, 10)] = 0.0
    blooms: Annotated[float, between(0, 2)] = 0.0
    clean: Annotated[float, between(0, 10)] = 0.0
    wander: Annotated[float, at_least(0)] = 0.0
    lost: Annotated[float, between(0, 1)] = 0.0
    charged: Annotated[float, between(0, 2)] = 0.0
    halftones: Annotated[float, between(0, 1)] = 0.0
    frayed: Annotated[float, between(0, 10)] = 0.0
    border: Annotated[float, between(0, 50)] = 0.0
    seed: Annotated[int, between(0, 2**31 - 1)] = 0

    @abstractmethod
    def surface(self, x: Tensor, y: Tensor) -> Tensor:
        """Compute heights (float32) of mean about 0 and standard deviation about 1, at positions measured in grains."""

    def margin(self, size: tuple[int, int]) -> int:
        around = (self.rims, self.clean, self.wander, self.lost, self.charged, self.accents, self.halftones, self.drag)
        drawn = (4 * HAND + LINE_REACH) * (self.drag > 0)
        drawn += 3 * (RUNS + RAN + NEARBY) * (max(self.lost, self.charged) > 0)
        drawn += (12 * CRISP + 2 * self.clean) * (self.clean > 0)
        return math.ceil((4 * RIM + 3 * self.wander + drawn) * self._grain_of(size)) + 2 if max(around) > 0 else 0

    def _grain_of(self, size: tuple[int, int]) -> float:
        """Return the size of a grain in pixels."""
        return self.grain / THOUSANDTHS * max(size)

    def _in_grains(self, rows: Rows) -> tuple[Tensor, Tensor]:
        x, y = rows.places
        return x * THOUSANDTHS / self.grain, y * THOUSANDTHS / self.grain

    def _heights(self, rows: Rows) -> Tensor:
        return self.surface(*self._in_grains(rows))

    def relief(self, rows: Rows) -> Tensor:
        return self.roughness * self._grain_of(rows.size) * (self._heights(rows).float() + DEEPEST).clamp_min(0)

    def cover(self, flat: Tensor, bare: Tensor, rows: Rows) -> Tensor:
        low, grain = map_to_uniform(self._mix_streaks(flat, rows)).to(flat), self._grain_of(rows.size)
        x, y = rows.places
        if self.clean:
            flat = with_clean_edges(flat, CRISP * grain, self.clean * grain)
        if self.wander:
            flat = displace_pixels(flat, *self._in_grains(rows), self.wander * grain, self.seed)
        if self.lost or self.charged:
            ran = gaussian_blur(
                displace_pixels(flat, *self._in_grains(rows), RUNS * grain, self.seed + 51), RAN * grain
            )
            detail = gaussian_blur((flat - ran).abs().amax(0, keepdim=True), NEARBY * grain)[0]
            dry = (SPARED * detail).clamp(0, 1)  # small details are painted after the rest has dried
            wet = map_to_uniform(fractal_noise(x / WET, y / WET, self.seed + 53, 3)).to(flat) - dry
            flat = torch.lerp(flat, ran, ((wet - 1 + self.lost) / SOAKED).clamp(0, 1))
            hue = self.charged * (1 - dry) * fractal_noise(x / HUES, y / HUES, self.seed + 57, 3).to(flat)
        ground = bare[:, None, None]
        density = self.granulation * (0.5 - low)
        if self.granulation:
            load = (POOLED * (ground - flat).mean(0)).clamp(0, 1)
            pools = load * map_to_uniform(fractal_noise(x / POOLS, y / POOLS, self.seed + 61, 3)).to(flat)
            density = density * (GRANULATED + (1 - GRANULATED) * pools)
        if self.blooms:
            density = density + self.blooms * 0.3 * fractal_noise(x / 0.12, y / 0.12, self.seed + 7, 4).to(flat)
        if self.rims:
            density = density + self.rims * density_of_edges(flat, RIM * grain)
        if self.charged:
            density = density + hue * flat.new_tensor(COOLER)[:, None, None]
        painted = (THICK * (flat - ground).abs().amax(0)).clamp(0, 1)  # bare paper stays unchanged
        flat = gather_pigment(flat, painted * density)
        within = self._within(rows).to(flat) if self.border else torch.ones_like(low)
        if self.border:
            flat = ground + (within * THOUSANDTHS / self.grain / FADE + 0.5).clamp(0, 1) * (flat - ground)
        if self.tooth == 0:
            return flat
        pressed = self.pressure * fractal_noise(x / PRESSURE, y / PRESSURE, self.seed + 11, UNEVEN)
        skipped = self.tooth * (1 + pressed.to(flat))
        if self.accents or self.halftones:
            around = gaussian_blur(flat, RIM * grain)
            detail, unlike = (flat - around).abs().amax(0), (around - ground).mean(0).abs()
            skipped = skipped * (1 - self.accents * (ACCENT * detail).clamp(0, 1))
            skipped = skipped - self.halftones * (self.tooth + PRESSED) * (UNLIKE * unlike).clamp(0, 1)
        if self.border and self.frayed:
            skipped = 1 - (1 - skipped) * (within * HUNDREDTHS / self.border / self.frayed).clamp(0, 1).sqrt()
        covered = (0.5 + STEEP / (1 + self.dust) * (low - skipped)).clamp(0, 1)
        return ground + torch.lerp(covered, torch.ones_like(covered), LEFT * self.dust) * (flat - ground)

    def _within(self, rows: Rows) -> Tensor:
        """Compute each pixel's distance (h, W), per longer side, from a border that wavers as if drawn by hand."""
        x, y = rows.places
        height, width = (side / max(rows.size) for side in rows.size)
        reach = torch.minimum(torch.minimum(x, width - x), torch.minimum(y, height - y)).float()
        return reach - self.border / HUNDREDTHS * (1 + WAVER * fractal_noise(x / WAVES, y / WAVES, self.seed + 41, 5))

    def _mix_streaks(self, flat: Tensor, rows: Rows) -> Tensor:
        """Compute the heights (h, W) that a stick meets: the paper's heights, mixed with streaks along the strokes."""
        heights = self._heights(rows)
        if self.drag == 0:
            return heights
        (x, y), grain = self._in_grains(rows), self._grain_of(rows.size)
        noise = fractal_noise(x / STREAK, y / STREAK, self.seed + 17, 2)
        streaks = draw_out(noise, direction_of_edges(flat, HAND * grain), LINE_REACH * grain)
        return torch.lerp(heights.float(), streaks, self.drag) / math.hypot(self.drag, 1 - self.drag)


@register("paper", "cold_pressed")
class ColdPressed(GrainedPaper):
    """Watercolour paper with the even, felt-like grain of cold pressing."""

    def surface(self, x: Tensor, y: Tensor) -> Tensor:
        return fractal_noise(x / 1.6, y / 1.6, self.seed, 3)


@register("paper", "rough")
class Rough(GrainedPaper):
    """Rough paper: pebbles between narrow hollows, which dry paint and chalk skip."""

    def surface(self, x: Tensor, y: Tensor) -> Tensor:
        pebbles = gradient_noise(x / 1.7, y / 1.7, self.seed).abs() - 0.18
        return 0.45 * pebbles / 0.14 + 0.8 * fractal_noise(x / 2.6, y / 2.6, self.seed + 3, 4)


@register("paper", "laid")
class Laid(GrainedPaper):
    """Laid paper: fine ribs from the wires of the mould, crossed by chain lines."""

    def surface(self, x: Tensor, y: Tensor) -> Tensor:
        waver = 0.25 * gradient_noise(x / 12, y / 12, self.seed)
        ribs = torch.cos(2 * math.pi * (y / 1.6 + waver))
        chains = torch.exp(-(((x / 24 + waver / 8) % 1 - 0.5) / 0.03).square())
        return 0.9 * ribs - 1.2 * chains + 0.6 * fractal_noise(x / 1.5, y / 1.5, self.seed + 3, 2)


@register("paper", "weave")
class Weave(GrainedPaper):
    """Plain-weave canvas: threads that pass over and under each other, each slightly different."""

    def surface(self, x: Tensor, y: Tensor) -> Tensor:
        u = x / 1.6 + 0.3 * gradient_noise(x / 9, y / 5, self.seed)
        v = y / 1.6 + 0.3 * gradient_noise(x / 5, y / 9, self.seed + 1)
        over = torch.cos(math.pi * u) * torch.cos(math.pi * v)  # warp where > 0, weft where < 0
        across = torch.where((u.floor() + v.floor()) % 2 == 0, (u % 1 - 0.5).abs(), (v % 1 - 0.5).abs())
        return 0.62 - 8.4 * across.square() + 0.2 * over + 0.35 * fractal_noise(x, y, self.seed + 3, 2)
