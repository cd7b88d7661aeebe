"""Read the claims of the thesis, and judge each by the paired difference that a study has measured."""

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from brushexp.errors import UserError
from brushexp.results.paired import NOT_DECIDED, Difference
from brushexp.results.quantities import quantities
from brushexp_thesis.entries import entries_in, read_plain_yaml

SHIPPED_CLAIMS = Path(__file__).with_suffix(".yaml")
BETTER, NO_WORSE, OPEN = "better", "no worse", "open"  # what can be expected of a setting


@dataclass(kw_only=True)
class Claim:
    """A sentence of the thesis, and the comparison that decides it: see claims.yaml."""

    study: str = ""
    says: str
    section: str
    setting: str
    against: str
    metric: str
    expects: str
    at_least: float = 1.0

    def verdict(self, difference: Difference | None) -> str:
        """Judge the claim by a measured difference, None if there is none; open claims get the answer itself."""
        if difference is None:
            return "not run"
        unclear = {NOT_DECIDED: NOT_DECIDED, "depends": "depends on the picture"}.get(difference.verdict)
        if self.expects == NO_WORSE:
            return "holds" if difference.is_no_worse else unclear or "does not hold"
        if unclear or self.expects == OPEN:
            return unclear or ("no difference" if difference.verdict == "same" else difference.verdict)
        threshold = math.log(self.at_least)
        if difference.verdict != "better" or difference.high < threshold:
            return "does not hold"
        return "holds" if difference.low >= threshold else NOT_DECIDED


def read_claims(path: Path = SHIPPED_CLAIMS) -> dict[str, list[Claim]]:
    """Read the claims of a YAML file by study; a UserError says which is incomplete, or names no metric."""
    try:
        data = read_plain_yaml(path, "give a file of claims")
        claims = {study: entries_in(Claim, listed, study) for study, listed in data.items()}
        for study, claim in ((study, claim) for study, listed in claims.items() for claim in listed):
            if claim.metric not in quantities() or claim.expects not in (BETTER, NO_WORSE, OPEN):
                raise UserError(f"'{claim.says}' has an unknown metric or expects; see the first lines")
            if not 0 < claim.at_least < math.inf:
                raise UserError(f"'{claim.says}' has at_least={claim.at_least}; give a ratio above 0")
            claim.study = str(study)
            claim.setting, claim.against = as_hydra_writes(claim.setting), as_hydra_writes(claim.against)
    except UserError as error:
        raise UserError(f"claims={path}: {error}") from error
    return claims


def as_hydra_writes(setting: str) -> str:
    """Write the overrides of a setting as Hydra gives them to jobs: ``critic=True critic_lr=0.0005``."""
    try:
        overrides = OverridesParser.create().parse_overrides(shlex.split(setting))
    except (HydraException, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"'{setting}' is no setting as studies list them: {reason}") from error
    return " ".join(f"{override.get_key_element()}={override.get_value_element_as_str()}" for override in overrides)
