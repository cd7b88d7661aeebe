"""Read the claims of the thesis, and judge each by the paired difference that a study has measured."""

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from brushexp_studies.paired import LEAST_UNITS, NOT_DECIDED, Difference
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from brushexp.contracts import UserError
from brushexp.contracts.results import quantities
from brushexp_thesis.entries import entries_in, read_plain_yaml
from brushexp_thesis.evidence import Bounds

SHIPPED_CLAIMS = Path(__file__).with_suffix(".yaml")
BETTER, NO_WORSE, OPEN = "better", "no worse", "open"  # what can be expected of a setting
HOLDS, FAILS, CANNOT, NOT_RUN = "holds", "does not hold", "cannot be answered here", "not run"
UNCLEAR = {NOT_DECIDED: NOT_DECIDED, "depends": "depends on the picture"}
COMPARED = ("setting", "against", "metric", "expects")  # what a claim needs, unless none could answer it


@dataclass(kw_only=True)
class Claim:
    """A sentence of the thesis, and the comparison that decides it: see claims.yaml."""

    study: str = ""
    says: str
    section: str
    setting: str = ""
    against: str = ""
    metric: str = ""
    expects: str = ""
    at_least: float = 1.0
    cannot: str = ""
    remark: str = ""
    after_results: bool = False

    def answer(self, difference: Difference) -> tuple[str, Bounds]:
        """Judge the claim by a measured difference; open claims get the answer itself.

        The bounds are those of the mean gain that the verdict states or, of an undecided one, that the claim does.
        """
        matters, least = difference.quantity.matters, math.log(self.at_least)
        larger = (0.0, math.inf) if difference.mean > 0 else (-math.inf, 0.0)
        stated = {BETTER: (least, math.inf), NO_WORSE: (-matters, math.inf)}.get(self.expects, larger)
        if self.expects == NO_WORSE and difference.is_no_worse:
            return HOLDS, stated
        is_no_gain = len(difference.gains) >= LEAST_UNITS and difference.high <= matters
        if self.expects == BETTER and difference.verdict == NOT_DECIDED and is_no_gain:
            return FAILS, (-math.inf, matters)
        if difference.verdict in UNCLEAR:
            return UNCLEAR[difference.verdict], stated
        measured = (-matters, matters) if difference.verdict == "same" else larger
        if self.expects == OPEN:
            return ("no difference" if difference.verdict == "same" else difference.verdict), measured
        if self.expects == NO_WORSE or difference.verdict != "better" or difference.high < least:
            return FAILS, ((-math.inf, least) if difference.verdict == "better" else measured)
        return (HOLDS if difference.low >= least else NOT_DECIDED), stated


def read_claims(path: Path = SHIPPED_CLAIMS) -> dict[str, list[Claim]]:
    """Read the claims of a YAML file by study; a UserError says which is incomplete, or names no metric."""
    try:
        data = read_plain_yaml(path, "give a file of claims")
        claims = {study: entries_in(Claim, listed, study) for study, listed in data.items()}
        for study, listed in claims.items():
            for number, claim in enumerate(listed, 1):
                claim.study = str(study)
                _check(claim, f"entry {number} of {study}")
                claim.setting, claim.against = as_hydra_writes(claim.setting), as_hydra_writes(claim.against)
    except UserError as error:
        raise UserError(f"claims={path}: {error}") from error
    return claims


def _check(claim: Claim, where: str) -> None:
    missing = [name for name in COMPARED if not getattr(claim, name)]
    if claim.cannot and len(missing) == len(COMPARED):
        return
    if missing:
        cure = "give each, or of a claim that no study can answer none of them, but cannot: why"
        raise UserError(f"{where} has no {' and no '.join(missing)}; {cure}")
    if claim.metric not in quantities() or claim.expects not in (BETTER, NO_WORSE, OPEN):
        raise UserError(f"'{claim.says}' has an unknown metric or expects; see the first lines")
    if not 0 < claim.at_least < math.inf:
        raise UserError(f"'{claim.says}' has at_least={claim.at_least}; give a ratio above 0")


def as_hydra_writes(setting: str) -> str:
    """Write the overrides of a setting as Hydra gives them to jobs: ``critic=True critic_lr=0.0005``."""
    try:
        overrides = OverridesParser.create().parse_overrides(shlex.split(setting))
    except (HydraException, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"'{setting}' is no setting as studies list them: {reason}") from error
    return " ".join(f"{override.get_key_element()}={override.get_value_element_as_str()}" for override in overrides)
