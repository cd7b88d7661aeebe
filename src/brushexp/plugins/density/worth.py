"""Choose the number of strokes so that each stroke is worth its bits."""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import torch
from torch import Tensor

from brushexp.bounds import at_least
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.density._proposals import proposals
from brushexp.plugins.density._trials import Trials
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

BITS = 150  # bits of a stroke, rounded and packed; metric=bits measures 143 for each of 106 strokes of look=plain
FEWEST, FIRST = 4, 16  # initial number of strokes if there are enough steps for growth, and its maximum
HALVINGS = 2  # largest number of halvings from the canvas to the smallest picture on which strokes grow
SMALLEST_SIDE = 96  # pixels on the shorter side of such a picture
ROOM = 100  # minimum pixels per stroke of such a picture
REST = 2  # rounds without change after the size of the picture changes, because edges become crisper
ROUND = 10  # steps between two rounds
SETTLING_ROUND = 20  # steps between two rounds after growth, for a given price
BATCH = 3  # number of strokes that every round may add
GROWTH = 0.5  # share of the strokes that a round of growth may add
PROMISE = 0.5  # smallest gain of a proposal, relative to the price of a stroke, because steps improve it
SWAP = 0.3  # importance below which a stroke is removed, relative to the gain of the worst accepted proposal
GROWN = 0.03  # share of the strokes; growth to a PSNR ends when rounds add less
GAIN = 0.03  # relative fall of distortion + price * rate below which a round of growth does not pay
PATIENCE = 2  # number of such consecutive rounds that end growth; one is enough after growth on a smaller picture
GROWING = 0.45  # largest share of the steps for growth
SETTLING = 60, 120  # minimum number of steps after growth, for a given price and to a PSNR
SETTLING_SHARE = 0.8, 1.0  # steps after growth relative to those of growth, for a given price and to a PSNR
STEPS_PAY = 0.01  # relative fall of distortion + price * rate below which a later round is the last one
LAST_ROUNDS = 0.6  # share of the steps after growth from which a round may be the last one
SETTLED = 2.5  # factor by which these steps lower the squared error
REMOVED = 0.1  # share of the strokes that a later round may remove
ADDED = 0.15  # share of the strokes that a later round may add
ADDING = 0.75  # share of the steps after which no strokes are added, unless there is a PSNR to reach
LATEST = 0.9  # share of the steps after which no strokes are added or removed until the last step
EXTRA = 60  # steps after a correction or a trial at the end
LONGEST = 2.0  # largest number of steps including corrections and trials, relative to the planned steps
RECOVERED = 0.3  # share of the removed importance for which the remaining strokes compensate
MARGIN = 0.01  # dB above the PSNR to reach
ROUNDING = 1 / 12 / 255**2  # mean squared error of rounding to 8 bits
HUNDRED = 100  # number of further strokes whose gain the verdict states
POINTS = 12  # points of the curve without the least important strokes


@register("density", "worth")
@dataclass(kw_only=True)
class Worth(Density):
    """Finds how many strokes the picture needs: as many as are worth their bits, or the fewest that reach a given PSNR.

    The painting minimises distortion + price * rate. Distortion is the squared error, summed over pixels and channels
    and weighted by the focus; the rate is 150 bits per stroke.

    - It starts with 4 strokes, or up to 16 if there are few steps. Every 10 steps, it proposes strokes of all sizes
      where they lower the error most, adds up to half as many strokes as exist, and removes each stroke whose removal
      costs less than its price.
    - The number of strokes grows on the picture at a quarter and then at half of its size, as long as this picture has
      100 pixels per stroke and a round lowers distortion + price * rate by 3 %. When rounds at full size lower it by
      less, growth ends.
    - Steps with a falling learning rate follow, until 20 of them lower distortion + price * rate by less than 1 %.
      Strokes that are no longer worth their price are removed.
    - With ``psnr=``, the price follows from the PSNR. Growth ends when the remaining steps are expected to reach the
      PSNR; later rounds remove the least important strokes while the others are good enough, and add strokes if they
      are not. At the end, strokes are added until the PSNR is reached, each time with 60 more steps. Then a trial
      removes a tenth of the strokes, which are restored if the others miss the PSNR 60 steps later. After each failed
      trial, up to four times, the next trial removes half as many.

    ``strokes=`` or ``max_strokes=`` limits the number of strokes (the default limit is one per 16 pixels). ``steps=``
    limits the number of steps, but corrections and trials may double it.

    Source: rate-distortion optimisation with a Lagrange multiplier (Shoham and Gersho, 1988), applied to strokes.

    Args:
        price: squared error that each bit must save, summed over pixels and channels in [0, 1].
    """

    price: Annotated[float, at_least(0)] = 1e-3
    _limit: int = field(default=0, init=False)  # planned steps
    _grown: int = field(default=0, init=False)  # step at which growth ended; 0 until then
    _is_cut_short: bool = field(default=False, init=False)  # whether lack of steps ended growth
    _idle: int = field(default=0, init=False)  # number of consecutive rounds that did not pay
    _cost: float = field(default=math.inf, init=False)  # lowest distortion + price * rate, on pictures of one size
    _halvings: int = field(default=HALVINGS, init=False)  # largest number for the picture on which strokes grow
    _rest: int = field(default=0, init=False)  # remaining rounds without change
    _patience: int = field(default=PATIENCE, init=False)  # consecutive rounds that do not pay and end growth
    _trials: Trials = field(default_factory=Trials, init=False)  # trials with fewer strokes, at the end
    _history: list[tuple[int, float]] = field(default_factory=list, init=False)  # strokes and PSNR at each round
    _findings: dict[str, Any] = field(default_factory=dict, init=False)
    _reason: str = field(default="", init=False)
    chooses_number = True
    uses_importance = True

    def first(self, budget: int, steps: int) -> int:
        rounds = GROWING * steps / ROUND
        return min(budget, max(FEWEST, min(FIRST, math.ceil(budget / (1 + GROWTH) ** rounds))))

    def idle_reason(self, steps: int) -> str:
        if steps >= 2 * ROUND:
            return ""
        most = f"at {FIRST} strokes or fewer in {steps} steps"
        return f"stays {most}; it adds strokes with steps={2 * ROUND} or more"

    def zoom(self, n: int, size: tuple[int, int], psnr: float | None) -> float:
        halvings = 0 if self._grown or psnr is not None else self._halvings
        while halvings and (min(size) < SMALLEST_SIDE * 2**halvings or math.prod(size) < ROOM * n * 4**halvings):
            halvings -= 1
        return 0.5**halvings

    def due(self, step: int, steps: int) -> bool:
        return step % ROUND == 0 or step >= steps

    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        if not self._limit or not state.may_replan:  # a time limit revises the number of steps
            self._limit = state.steps
        self._history.append((len(state.strokes), _psnr_of(_mean_error(state))))
        if state.step >= state.steps:
            return self._correct(state) if state.may_replan and state.psnr is not None else None
        if not self._grown:
            return self._grow(state)
        if state.step >= LATEST * state.steps or (state.psnr is None and state.step % SETTLING_ROUND):
            return None
        return self._settle(state) if state.psnr is None else self._approach(state, state.psnr)

    def _grow(self, state: DensificationState) -> DensificationUpdate | None:
        """Add as many of the best proposals as allowed, and remove strokes that are not worth their price."""
        is_over = state.step >= GROWING * self._limit
        if self._is_resting(state) and not is_over:
            return None
        n, importance = len(state.strokes), state.importance()
        most = min(state.budget - n, max(BATCH, round(GROWTH * n)))
        if state.psnr is None:
            price = BITS * self.price * state.zoom**2
            new, _ = proposals(state, most, PROMISE * price)
        else:
            missing = _total_error(state) - SETTLED * _allowed_error(state, state.psnr)
            new, gain = _as_many_as_gain(missing, *proposals(state, most, 0.0))
            price = SWAP * float(gain.min()) if len(new) else 0.0
        keep = _worth_more(importance, price)
        added = len(new) - int((~keep).sum())
        pays = added >= max(1, GROWN * n) if state.psnr is not None else self._falls(state, GAIN)
        self._idle = 0 if pays else self._idle + 1
        is_reached = state.psnr is not None and not len(new)
        if self._halvings and self._idle and not is_over:
            self._enlarge(self._halvings - 1)
            self._patience = 1
            return DensificationUpdate(keep, new)
        is_growing = self._idle < self._patience and not is_reached and n < state.budget
        if is_growing and not is_over:
            return DensificationUpdate(keep, new)
        self._grown, self._is_cut_short, self._cost = state.step, is_growing, math.inf
        is_goal = state.psnr is not None
        steps = max(SETTLING[is_goal], round(SETTLING_SHARE[is_goal] * state.step))
        return DensificationUpdate(keep, new, min(self._limit, state.step + steps) if state.may_replan else None)

    def _is_resting(self, state: DensificationState) -> bool:
        """Check whether a round leaves the strokes unchanged because the picture's size has just changed."""
        halvings = round(-math.log2(state.zoom))
        if halvings < self._halvings:  # there are too many strokes for a smaller picture, or it would be too small
            self._enlarge(halvings)
            self._rest = REST if len(self._history) > 1 else 0
        self._rest -= 1
        return self._rest >= 0

    def _enlarge(self, halvings: int) -> None:
        """Start to add strokes on a larger picture."""
        self._halvings, self._idle, self._cost, self._rest = halvings, 0, math.inf, REST

    def _falls(self, state: DensificationState, share: float) -> bool:
        """Check whether distortion + price * rate is lower by a fraction ``share`` than in all earlier rounds."""
        cost = _total_error(state) / state.zoom**2 + BITS * self.price * len(state.strokes)
        is_lower = cost <= (1 - share) * self._cost
        self._cost = min(self._cost, cost)
        return is_lower

    def _settle(self, state: DensificationState) -> DensificationUpdate:
        """Remove strokes that are not worth their price; in early rounds, also add proposals that are worth it."""
        n, price = len(state.strokes), BITS * self.price
        done = (state.step - self._grown) / max(1, state.steps - self._grown)
        if not self._falls(state, STEPS_PAY) and done >= LAST_ROUNDS and state.may_replan:
            keep = _worth_more(state.importance(), price)
            return DensificationUpdate(keep, Strokes.none(state.strokes.position), state.step)
        most = min(state.budget - n, max(BATCH, round(ADDED * n))) if state.step < ADDING * state.steps else 0
        new, _ = proposals(state, most, price)
        return DensificationUpdate(_worth_more(state.importance(), price), new)

    def _approach(self, state: DensificationState, psnr: float) -> DensificationUpdate:
        """Add or remove strokes so that the painting is expected to end at the given PSNR."""
        left = min(1.0, 2 * (1 - state.step / state.steps))
        expected = _total_error(state) / (1 + (SETTLED - 1) * left)
        slack = _allowed_error(state, psnr) - expected
        return self._more(state, -slack) if slack < 0 else self._fewer(state, slack / (1 - RECOVERED))

    def _correct(self, state: DensificationState) -> DensificationUpdate | None:
        """Add strokes if the painting is not good enough; otherwise, try fewer strokes or finish."""
        assert state.psnr is not None
        slack = _allowed_error(state, state.psnr) - _total_error(state)
        steps = state.step + EXTRA if state.step + EXTRA <= LONGEST * self._limit else None
        if slack < 0 and self._trials.strokes is None:
            update = self._more(state, -slack)
            return replace(update, steps=steps) if steps is not None and len(update.new) else None
        return self._trials.next(state, slack, steps)

    def _more(self, state: DensificationState, missing: float) -> DensificationUpdate:
        """Add enough of the best proposals to lower the squared error by ``missing``."""
        n = len(state.strokes)
        most = min(state.budget - n, max(BATCH, round(ADDED * n)))
        new, _ = _as_many_as_gain(missing, *proposals(state, most, 0.0))
        return DensificationUpdate(state.strokes.opacity.new_ones(n, dtype=torch.bool), new)

    def _fewer(self, state: DensificationState, slack: float) -> DensificationUpdate:
        """Remove the least important strokes as long as the squared error grows by no more than ``slack``."""
        importance, n = state.importance(), len(state.strokes)
        ranks = importance.argsort(stable=True)
        spare = int((importance[ranks].clamp_min(0).cumsum(0) <= slack).sum())
        keep = torch.ones_like(importance, dtype=torch.bool)
        keep[ranks[: max(0, min(spare, max(1, round(REMOVED * n)), n - 1))]] = False
        return DensificationUpdate(keep, Strokes.none(state.strokes.position))

    def conclude(self, state: DensificationState) -> None:
        """Measure how much PSNR the least important strokes add, and how much a hundred more strokes would add."""
        n, values = len(state.strokes), state.target.numel()
        mean, ranked = _mean_error(state), state.importance().clamp_min(0).sort().values.cumsum(0)
        _, gain = proposals(state, HUNDRED, 0.0)
        fewer = sorted({round(n * share / POINTS) for share in range(1, POINTS)} - {0})
        gained = _psnr_of(max(0.0, mean - float(gain.sum()) / values))
        curve = [(n - k, _psnr_of(mean + float(ranked[k - 1]) / values)) for k in fewer[::-1]]
        curve += [(n, _psnr_of(mean)), (n + len(gain), gained)] if len(gain) else [(n, _psnr_of(mean))]
        self._reason = self._explain(state, _psnr_of(mean), float(gain[0]) if len(gain) else 0.0)
        self._findings = {
            "strokes_needed": n,
            "next_hundred_db": gained - _psnr_of(mean),
            "strokes_psnr": [[count, round(psnr, 3)] for count, psnr in curve],
            "growth": [[count, round(psnr, 3)] for count, psnr in self._history],
            "verdict": self._sentence(n, gained - _psnr_of(mean)),
        }

    def _explain(self, state: DensificationState, reached: float, best_gain: float) -> str:
        at_limit = len(state.strokes) >= state.budget
        if state.psnr is None:
            more = f"; more would be worth a price of {self.price:g}" if self.price else ""
            if at_limit and best_gain > BITS * self.price:
                return f"as many as max_strokes={state.budget} allows{more}"
            if self._is_cut_short:
                return f"as many as grew in steps={self._limit}{more}"
            return f"each saves more than its price, {self.price:g} of squared error per bit"
        if reached >= state.psnr:
            return f"the fewest found for psnr={state.psnr:g}"
        limit = f"max_strokes={state.budget}" if at_limit else f"steps={self._limit}"
        return f"psnr={state.psnr:g} was not reached, only {reached:.2f} dB, within {limit}"

    def findings(self) -> dict[str, Any]:
        return self._findings

    def _sentence(self, n: int, gain: float) -> str:
        strokes = f"{n:,} stroke{'s' * (n != 1)}"
        return f"{strokes}: {self._reason}; the next hundred would gain about {gain:.2f} dB"

    def state_dict(self) -> dict[str, Any]:
        return {
            "limit": self._limit,
            "grown": self._grown,
            "is_cut_short": self._is_cut_short,
            "idle": self._idle,
            "cost": self._cost,
            "halvings": self._halvings,
            "rest": self._rest,
            "patience": self._patience,
            "history": self._history,
            "trials": self._trials.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._limit, self._grown, self._idle = state["limit"], state["grown"], state["idle"]
        self._is_cut_short = state["is_cut_short"]
        self._cost, self._halvings = state["cost"], state["halvings"]
        self._rest, self._patience = state["rest"], state["patience"]
        self._history = [(int(count), float(psnr)) for count, psnr in state["history"]]
        self._trials.load_state_dict(state["trials"])


def _mean_error(state: DensificationState) -> float:
    return float((state.image - state.target).square().mean())


def _psnr_of(mean_squared_error: float) -> float:
    """Compute the PSNR, in dB, after rounding to 8 bits, which limits it to 59 dB."""
    return psnr_of(mean_squared_error + ROUNDING)


def _total_error(state: DensificationState) -> float:
    return _mean_error(state) * state.target.numel()


def _allowed_error(state: DensificationState, psnr: float) -> float:
    """Compute the squared error, summed over pixels and channels, at which an 8-bit painting reaches this PSNR."""
    return (10 ** (-(psnr + MARGIN) / 10) - ROUNDING) * state.target.numel()


def _worth_more(importance: Tensor, price: float) -> Tensor:
    """Mark the strokes (N,) that are worth more than their price; the most important stroke is always included."""
    keep = importance > price
    if len(keep):
        keep[importance.argmax()] = True
    return keep


def _as_many_as_gain(missing: float, new: Strokes, gain: Tensor) -> tuple[Strokes, Tensor]:
    """Select proposals in order until their gains add up to ``missing`` or no proposals are left."""
    count = 0 if missing <= 0 else int((gain.cumsum(0) < missing).sum()) + 1
    return new[:count], gain[:count]
