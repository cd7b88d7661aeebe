"""Test all claims on a page against the available studies, and gather further evidence for and against each claim."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from brushexp_studies.paired import (
    CONFIDENCE,
    LEAST_UNITS,
    NOT_DECIDED,
    PICTURE,
    Difference,
    format_ratio,
    interval,
)

from brushexp.contracts.results import holm
from brushexp_thesis.claims import CANNOT, DEPENDS, NOT_RUN, Claim
from brushexp_thesis.evidence import detectable_effect, median_of, p_of_gains_and_losses, p_of_mean, p_of_ranks
from brushexp_thesis.study_records import Study

LEAST_RANKED = 6  # minimum number of units at which ranks can be significant


@dataclass(frozen=True)
class Judgement:
    """A claim, its verdict and the evidence for it.

    ``difference`` decides the claim; it is None if there is no study. ``p`` is the p-value of the statement made by the
    verdict or, if it is undecided, by the claim, corrected for the number of claims on the page. ``alone`` is the
    verdict before this correction. ``p_ranks`` is the uncorrected p-value of the signed-rank test.
    """

    claim: Claim
    difference: Difference | None
    verdict: str
    alone: str
    p: float | None = None
    p_ranks: float | None = None

    @property
    def effect(self) -> str:
        """The measured mean with its interval; if the verdict depends on the picture, also how many gained and lost."""
        assert self.difference is not None
        one = self.difference
        if one.verdict != "depends":
            return one.effect
        better, worse = len(one.units_that_gain(1)), len(one.units_that_gain(-1))
        return f"{one.effect}; better on {better}, worse on {worse} of {len(one.gains)}"

    @property
    def power(self) -> str:
        """The smallest effect that a study of this size and spread would detect; "" if there are too few units."""
        assert self.difference is not None
        found = detectable_effect(self.difference)
        quantity = self.difference.quantity
        if not math.isfinite(found):
            return ""
        return format_ratio(found) if quantity.ratio else f"{found:.{quantity.digits}f}"

    @property
    def note(self) -> str:
        """The qualifications of the verdict, separated by semicolons."""
        notes = [
            "post hoc" * self.claim.after_results,
            f"alone: {self.alone}" * (self.alone != self.verdict),
            self._word_of_ranks(),
        ]
        return "; ".join(filter(None, notes))

    @property
    def remark(self) -> str:
        """The reason why the study does not decide the claim, or a remark on how to read the verdict."""
        if self.claim.cannot:
            return f"Cannot be answered here: {self.claim.cannot}."
        if self.claim.needs:
            return f"Not run: {self.claim.needs}."
        return self.claim.remark and f"{self.claim.remark}."

    def _word_of_ranks(self) -> str:
        """Return a note if the signed-rank test and Student's t-test disagree on whether the claim is decided.

        Returns "" if they agree.
        """
        if self.p_ranks is None or self.difference is None or len(self.difference.gains) < LEAST_RANKED:
            return ""
        differ = (self.p_ranks < 1 - CONFIDENCE) != (self.alone != NOT_DECIDED)
        return f"ranks differ: p {format_p(self.p_ranks)}" * differ


def judge(claims: Iterable[Claim], studies: Mapping[str, Study]) -> list[Judgement]:
    """Judge every claim, and correct the p-values for the number of claims by Holm's method."""
    single = [_judge_alone(claim, studies) for claim in claims]
    corrected = iter(holm([one.p for one in single if one.p is not None]))
    return [one if one.p is None else _correct(one, next(corrected)) for one in single]


def _correct(one: Judgement, p: float) -> Judgement:
    """Replace a claim's p-value with the corrected one; if this is too large, the verdict becomes undecided."""
    is_doubtful = p >= 1 - CONFIDENCE and one.verdict != NOT_DECIDED
    return replace(one, p=p, verdict=NOT_DECIDED if is_doubtful else one.verdict)


def _judge_alone(claim: Claim, studies: Mapping[str, Study]) -> Judgement:
    difference = studies[claim.study].difference(claim) if claim.study in studies else None
    if difference is None or claim.cannot or claim.needs:
        verdict = CANNOT if claim.cannot else NOT_RUN
        return Judgement(claim, difference, verdict, verdict)
    verdict, stated = claim.answer(difference)
    gains = list(difference.gains.values())
    if verdict == DEPENDS:
        return Judgement(claim, difference, verdict, verdict, p_of_gains_and_losses(gains, difference.quantity.matters))
    return Judgement(claim, difference, verdict, verdict, p_of_mean(gains, stated), p_of_ranks(gains, stated))


def evidence_row(judgement: Judgement, paintings: Collection[str]) -> dict[str, str]:
    """Return a table row with the measurements behind a claim.

    These are the mean, the median, the numbers of pictures or seeds that got better and worse, and the p-value of the
    signed-rank test. The mean is also given separately for photographs and for paintings.
    """
    claim, one = judgement.claim, judgement.difference
    assert one is not None
    better, worse = len(one.units_that_gain(1)), len(one.units_that_gain(-1))
    kinds = {"photographs": [], "paintings": []} if one.unit == PICTURE else {}  # type: dict[str, list[float]]
    for unit, gain in one.gains.items() if kinds else ():
        kinds["paintings" if unit in paintings else "photographs"].append(gain)
    return {
        "claim": claim.says,
        "compared": f"{claim.setting} against {claim.against}",
        "metric": one.quantity.name,
        "mean": one.effect,
        "median": _in_words(one, median_of(list(one.gains.values()), CONFIDENCE)),
        "better, worse": f"{better}, {worse} of {len(one.gains)}",
        "p of ranks": "" if judgement.p_ranks is None else format_p(judgement.p_ranks),
        **{kind: _in_words(one, interval(gains)) for kind, gains in kinds.items() if len(gains) >= LEAST_UNITS},
    }


def _in_words(one: Difference, middle_low_high: Sequence[float]) -> str:
    middle, low, high = middle_low_high
    return replace(one, mean=middle, low=low, high=high).effect


def format_p(p: float) -> str:
    """Format a p-value with two significant digits: ``0.031``, ``< 0.0001``."""
    return "< 0.0001" if p < 1e-4 else f"{p:#.2g}"
