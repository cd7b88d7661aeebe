"""Read the thesis's claims, and decide each claim by the paired difference that a study has measured."""

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
BETTER, NO_WORSE, OPEN = "better", "no worse", "open"  # possible expectations of a setting
HOLDS, FAILS, CANNOT, NOT_RUN = "holds", "does not hold", "cannot be answered here", "not run"
DEPENDS = "depends on the picture"
COMPARED = ("setting", "against", "metric", "expects")  # fields that a claim needs unless no study has answered it


@dataclass(kw_only=True)
class Claim:
    """A claim of the thesis, and the comparison that decides whether it holds; see claims.yaml.

    ``cannot`` states why no study here could test the claim. ``needs`` states what a study would need in order to test
    it; if it is given, the verdict is *not run*, regardless of what the claim's study has measured.
    """

    study: str = ""
    says: str
    section: str
    setting: str = ""
    against: str = ""
    metric: str = ""
    expects: str = ""
    at_least: float = 1.0
    cannot: str = ""
    needs: str = ""
    remark: str = ""
    after_results: bool = False

    def answer(self, difference: Difference) -> tuple[str, Bounds]:
        """Decide the claim, given a measured difference; return the verdict and the tested bounds on the mean gain.

        The bounds are the ones stated by the verdict or, if the claim is not decided, by the claim. If the claim states
        a gain, the first test is whether the data exclude a gain that matters. An open claim receives the verdict of
        the difference.
        """
        matters, least = difference.quantity.matters, math.log(self.at_least)
        larger = (0.0, math.inf) if difference.mean > 0 else (-math.inf, 0.0)
        claimed = {BETTER: (least, math.inf), NO_WORSE: (-matters, math.inf)}.get(self.expects, larger)
        no_gain = (-math.inf, max(least, matters))
        is_measured = len(difference.gains) >= LEAST_UNITS and math.isfinite(difference.low)
        if self.expects == BETTER and is_measured and difference.high <= no_gain[1]:
            return FAILS, no_gain
        if difference.verdict == "depends":
            return DEPENDS, claimed
        if self.expects == OPEN and difference.verdict == "same":
            return "no difference", (-matters, matters)
        if self.expects == OPEN:
            return difference.verdict, larger
        holds = is_measured and difference.low > least if self.expects == BETTER else difference.is_no_worse
        if self.expects == NO_WORSE and not holds and difference.verdict == "worse":
            return FAILS, larger
        return (HOLDS if holds else NOT_DECIDED), claimed


def read_claims(path: Path = SHIPPED_CLAIMS) -> dict[str, list[Claim]]:
    """Read a YAML file of claims by study; raise UserError if a claim is incomplete or its metric is unknown."""
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
    if (claim.cannot or claim.needs) and len(missing) == len(COMPARED):
        return
    if missing:
        cure = "give all; for a claim without a study give none, but cannot (why no study could answer it) or needs"
        raise UserError(f"{where} has no {' and no '.join(missing)}; {cure}")
    if claim.metric not in quantities() or claim.expects not in (BETTER, NO_WORSE, OPEN):
        raise UserError(f"'{claim.says}' has an unknown metric or expects; see the first lines of the file")
    if not 0 < claim.at_least < math.inf:
        raise UserError(f"'{claim.says}' has at_least={claim.at_least}; give a ratio above 0")


def as_hydra_writes(setting: str) -> str:
    """Format a setting's overrides as Hydra passes them to jobs: ``critic=True critic_lr=0.0005``."""
    try:
        overrides = OverridesParser.create().parse_overrides(shlex.split(setting))
    except (HydraException, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"'{setting}' is not a setting of a study: {reason}") from error
    return " ".join(f"{override.get_key_element()}={override.get_value_element_as_str()}" for override in overrides)
