"""Compute a print's size in cm and its resolution from the chosen paper, margins and bleed."""

from dataclasses import dataclass
from typing import Any

from brushexp.contracts.members import CM, DPI

SQUARE, OWN = "Square", "Own size"
PAPERS = {"A5": (21.0, 14.8), "A4": (29.7, 21.0), "A3": (42.0, 29.7), "A2": (59.4, 42.0)}  # cm, longer side first
MOST_PIXELS = 5000  # on the longer side: more than 300 dpi on A3; larger prints are viewed from farther away


@dataclass(frozen=True)
class Print:
    """The size of a print: the paper in cm, and the margin and bleed in mm."""

    paper: str = "A4"
    side: float = 30.0  # side in cm of a square, or longer side in cm of a picture with its own proportions
    fill: bool = False  # whether the picture is cropped to the shape of the paper
    margin: float = 0.0  # mm of white paper on each side
    bleed: float = 0.0  # mm beyond the edge on each side, to be trimmed

    @property
    def label(self) -> str:
        """The part of a saved file's name that identifies the print."""
        return self.paper.replace(" ", "_")

    @property
    def is_cropped(self) -> bool:
        """Whether the picture is cropped to fit the paper: always on square paper, never if `OWN` size is chosen."""
        return self.paper == SQUARE or (self.paper in PAPERS and self.fill)

    def box(self, ratio: float) -> tuple[float, float]:
        """Compute the paper's width and height in cm for a picture with the given ``ratio`` (width / height)."""
        longer, shorter = PAPERS.get(self.paper, (self.side, self.side))
        return (longer, shorter) if ratio >= 1 else (shorter, longer)

    def size(self, ratio: float) -> tuple[float, float]:
        """Compute the width and height of the print in cm, without bleed.

        >>> Print("A4").size(1.5), Print("A4", fill=True).size(1.5), Print("Square", side=20).size(0.7)
        ((29.7, 19.8), (29.7, 21.0), (20, 20))
        """
        width, height = self.box(ratio)
        if self.is_cropped:
            return width, height
        around = self.margin / 5  # both margins together, in cm
        across = min(width - around, (height - around) * ratio)
        return round(across + around, 1), round(across / ratio + around, 1)

    def dpi(self, ratio: float) -> int:
        """Compute the resolution in dpi: 300, or less if the longer side would exceed `MOST_PIXELS`.

        >>> Print("A4").dpi(1.5), Print("A2").dpi(1.5)
        (300, 213)
        """
        return int(min(DPI, MOST_PIXELS * CM / max(self.size(ratio))))

    def options(self, ratio: float) -> dict[str, Any]:
        """Return the exporter options for a picture with the given ``ratio`` (width / height)."""
        width, height = self.box(ratio)
        options = {"size_cm": f"{width:g}x{height:g}", "dpi": float(self.dpi(ratio))}
        return options | {"fill": self.is_cropped, "margin": self.margin, "bleed": self.bleed}

    def words(self, ratio: float) -> str:
        """Describe the size, bleed, resolution, margin and cropping of the print in one line.

        >>> Print("A4", bleed=3).words(1.5)
        '29.7 × 19.8 cm and 3 mm of bleed on each side, at 300 dpi'
        >>> Print("Square", side=20, margin=10).words(1.5)
        '20 × 20 cm at 300 dpi, of which the picture is 18 × 18 cm; a third of it is cropped'
        """
        width, height = self.size(ratio)
        bleed = f" and {self.bleed:g} mm of bleed on each side," if self.bleed else ""
        words = f"{width:g} × {height:g} cm{bleed} at {self.dpi(ratio)} dpi"
        across, up = width - self.margin / 5, height - self.margin / 5
        if self.margin:
            words += f", of which the picture is {across:.3g} × {up:.3g} cm"
        if self.is_cropped:
            lost = 1 - min(across / up / ratio, ratio * up / across)
            words += f"; {share_of(lost)} of it is cropped"
        return words


def share_of(share: float) -> str:
    """Format a fraction of a picture in words or per cent.

    >>> share_of(0.334), share_of(0.07), share_of(0)
    ('a third', '7 %', 'nothing')
    """
    names = {0: "nothing", 25: "a quarter", 33: "a third", 50: "half"}
    percent = round(100 * share)
    return names.get(percent, f"{percent} %")
