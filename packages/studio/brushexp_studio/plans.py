"""Choose the difficulty of a plan for painting by hand."""

from dataclasses import dataclass
from typing import Any

DIFFICULTIES = {"": "As painted", "easy": "Easy", "medium": "Medium", "hard": "Hard"}


@dataclass(frozen=True)
class Plan:
    """A plan with one of the ``DIFFICULTIES``."""

    difficulty: str = ""

    @property
    def label(self) -> str:
        """The part of a saved file's name that identifies the plan."""
        return self.difficulty

    def options(self, ratio: float) -> dict[str, Any]:
        """Convert to options of an exporter, for a picture with a ``ratio`` (width / height).

        >>> Plan("easy").options(1.5), Plan().options(1.5)
        ({'difficulty': 'easy'}, {})
        """
        return {"difficulty": self.difficulty} if self.difficulty else {}
