"""Store the chosen difficulty of a plan for painting by hand."""

from dataclasses import dataclass
from typing import Any

DIFFICULTIES = {"": "As painted", "easy": "Easy", "medium": "Medium", "hard": "Hard"}


@dataclass(frozen=True)
class Plan:
    """A plan for painting by hand, with one of the ``DIFFICULTIES``."""

    difficulty: str = ""

    @property
    def label(self) -> str:
        """The part of a saved file's name that identifies the plan."""
        return self.difficulty

    def options(self, ratio: float) -> dict[str, Any]:
        """Return the exporter options; ``ratio`` (width / height) is not used for plans.

        >>> Plan("easy").options(1.5), Plan().options(1.5)
        ({'difficulty': 'easy'}, {})
        """
        return {"difficulty": self.difficulty} if self.difficulty else {}
