"""What the thesis claims, and what the paired differences of a study make of it."""

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from brushexp.errors import UserError
from brushexp.results.paired import NOT_DECIDED, Difference
from brushexp.results.quantities import quantities
from brushexp.runs.sweep_report import first_line
from brushexp.system.reading import read_text, yaml_of

SHIPPED_CLAIMS = Path(__file__).with_suffix(".yaml")
BETTER, NO_WORSE, OPEN = "better", "no worse", "open"  # what can be expected of a setting
NOT_RUN = "not run"
KEYS = {"says", "section", "setting", "against", "metric", "expects"}


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One sentence, and the comparison that decides it: see results/claims.yaml."""

    study: str
    says: str
    section: str
    setting: str
    against: str
    metric: str
    expects: str
    at_least: float = 1.0

    def judged(self, found: Difference | None) -> str:
        """``holds``, ``does not hold``, ``depends on the picture``, ``not decided``, ``not run``, or what was asked."""
        if found is None:
            return NOT_RUN
        unclear = {NOT_DECIDED: NOT_DECIDED, "depends": "depends on the picture"}
        if self.expects == NO_WORSE:
            return "holds" if found.is_no_worse else unclear.get(found.verdict, "does not hold")
        if self.expects == OPEN or found.verdict in unclear:
            return unclear.get(found.verdict, "no difference" if found.verdict == "same" else found.verdict)
        wanted = math.log(self.at_least)
        if found.verdict != "better" or found.high < wanted:
            return "does not hold"
        return "holds" if found.low >= wanted else NOT_DECIDED


def read_claims(path: Path = SHIPPED_CLAIMS) -> dict[str, list[Claim]]:
    """The claims of a YAML file by study; a UserError says which is incomplete, or names no metric."""
    try:
        found: Mapping[str, Any] = yaml_of(read_text(path, "give a file of claims"))
        claims = {
            study: [Claim(study=study, **(given | {"section": str(given["section"])})) for given in listed]
            for study, listed in found.items()
        }
    except UserError as error:
        raise UserError(f"claims={path}: {error}") from error
    except (TypeError, KeyError, AttributeError) as error:
        raise UserError(f"claims={path}: each claim has the keys {', '.join(sorted(KEYS))}: {error}") from error
    for claim in (claim for listed in claims.values() for claim in listed):
        texts = (claim.says, claim.setting, claim.against)
        if claim.metric not in tuple(quantities()) or claim.expects not in (BETTER, NO_WORSE, OPEN):
            raise UserError(f"claims={path}: '{claim.says}' has an unknown metric or expects; see the first lines")
        if not all(isinstance(text, str) for text in texts):
            raise UserError(f"claims={path}: '{claim.says}' has a setting or against that is no text; quote it")
        if not isinstance(claim.at_least, int | float) or not 0 < claim.at_least < math.inf:
            raise UserError(f"claims={path}: '{claim.says}' has at_least={claim.at_least}; give a ratio above 0")
    return {
        study: [replace(one, setting=spelt(one.setting, path), against=spelt(one.against, path)) for one in listed]
        for study, listed in claims.items()
    }


def spelt(setting: str, path: Path) -> str:
    """The overrides of a setting as Hydra gives them to jobs: ``critic=True critic_lr=0.0005``; UserError if none."""
    try:
        found = OverridesParser.create().parse_overrides(shlex.split(setting))
    except (HydraException, ValueError) as error:
        wrong = f"'{setting}' is no setting as studies list them"
        raise UserError(f"claims={path}: {wrong}: {first_line(error)}") from error
    return " ".join(f"{override.get_key_element()}={override.get_value_element_as_str()}" for override in found)
