"""Where the weights of `r_stdp` go: the expected change of a weight, by how trials end and when its input comes.

Weights are shares of the way from Wmin to Wmax. docs/explanation/recognisers.md derives the formulas.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import neuro
from neuro import ModelError
from neuro_doctor.findings import Finding, figure, warning
from neuro_doctor.wiring import Wiring

Floats = NDArray[np.float64]

EARLY, EARLY_AT_MOST = 0.25, 0.58
"""Shares of the way from chance to no mistake that decisions reach before epsilon has lifted weights. ReMuS on N-MNIST
reaches 0.24 to 0.27 in the first 1000 trials at a threshold of 30, and 0.37 to 0.58 at 60, by the recordings that are
drawn: docs/explanation/recognisers.md."""


class Shares(NamedTuple):
    """Shares of all trials in which a weight is taught, of one weight or of many.

    Attributes:
        rewarded: the weight's neuron was rewarded, and its input came before, at or after the decision, which includes
            silence; shape (3, ...).
        punished: the neuron was punished, likewise.
        grown: the trial was wrong or silent, and its label is that of the weight's map; shape (...).
    """

    rewarded: Floats
    punished: Floats
    grown: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The expected change of a weight w in a trial, push w (1 - w) + lift.

    Attributes:
        push: mean rate of rewards and punishments in a trial.
        lift: growth by epsilon in a trial, not negative.
    """

    push: Floats
    lift: Floats

    def change(self, weight: ArrayLike) -> Floats:
        """Return the expected change of a weight in a trial, away from the bounds."""
        w = np.asarray(weight, dtype=np.float64)
        return self.push * w * (1.0 - w) + self.lift

    def fixed_points(self) -> tuple[Floats, Floats]:
        """Return the weight to which a weight drifts, and the weight above which it drifts to the upper bound.

        Where the push is not negative, or the lift is above a quarter of it, weights end at the upper bound from
        anywhere: 1 and 0. Where both are 0 nothing drifts: NaN.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            room = 1.0 + 4.0 * self.lift / self.push
            apart = np.sqrt(np.where((self.push < 0.0) & (room >= 0.0), room, np.nan))
        rests = (self.push == 0.0) & (self.lift == 0.0)
        ends = [np.where(np.isnan(apart), end, (1.0 + way * apart) / 2.0) for way, end in ((-1.0, 1.0), (1.0, 0.0))]
        low, high = (np.where(rests, np.nan, each) for each in ends)
        return low, high

    def after(self, weight: ArrayLike, trials: ArrayLike) -> Floats:
        """Return the weight after a number of trials with the same shares: the solution of dw/dn = `change`, cut at 1.

        With w = u / v the equation is linear: u' = (push u) / 2 + lift v, v' = push u - (push v) / 2.
        """
        w, n = np.asarray(weight, dtype=np.float64), np.asarray(trials, dtype=np.float64)
        half = self.push / 2.0
        square = self.push * (self.push / 4.0 + self.lift)
        s, rise, fall = np.sqrt(np.abs(square)), half * w + self.lift, half - self.push * w
        q = np.exp(-2.0 * s * n)  # u and v times exp(-s n), so that long courses stay finite
        hyperbolic = (s * w + rise) + q * (s * w - rise), (s - fall) + q * (s + fall)
        circular = s * w * np.cos(s * n) + rise * np.sin(s * n), s * np.cos(s * n) - fall * np.sin(s * n)
        straight = w + n * rise, 1.0 - n * fall
        # A short way is straight, and the others lose digits on it.
        ways = [(square > 0.0) & (s * n > 1e-6), (square < 0.0) & (s * n > 1e-6)]
        u = np.select(ways, [hyperbolic[0], circular[0]], straight[0])
        v = np.select(ways, [hyperbolic[1], circular[1]], straight[1])
        # Without a fixed point only the bound ends the growth, and the quotient comes back from infinity.
        full = np.arctan2(s * (1.0 - w), self.lift + half * (1.0 - w))
        past = (v <= 0.0) | ((square < 0.0) & (s * n >= full))
        with np.errstate(divide="ignore", invalid="ignore"):
            reached: Floats = np.where(past, 1.0, np.clip(u / v, 0.0, 1.0))
        return np.where((w == 0.0) & (self.lift == 0.0), 0.0, reached)

    def saturating_epsilon(self, weight: ArrayLike, grown: ArrayLike) -> Floats:
        """Return the epsilon above which a weight ends at the upper bound.

        Args:
            weight: where it begins.
            grown: share of the trials in which epsilon is added, see `Shares`.
        """
        w = np.asarray(weight, dtype=np.float64)
        opposes = np.where(w > 0.5, w * (1.0 - w), 0.25)  # a weight below 1/2 has to pass where the push is strongest
        epsilon: Floats = np.maximum(-self.push, 0.0) * opposes / np.asarray(grown, dtype=np.float64)
        return epsilon


def drift_of(rule: neuro.r_stdp, shares: Shares) -> Drift:
    """Return the drift of weights that `r_stdp` teaches. With `rescue`, rescued trials count as rewarded."""
    tie = rule.Ar_minus if rule.ties_after else rule.Ar_plus
    rewards = (rule.Ar_plus, tie, rule.Ar_minus), shares.rewarded
    punishments = (rule.Ap_minus, rule.Ap_minus, rule.Ap_plus), shares.punished
    push: Floats = np.tensordot(rewards[0], rewards[1], axes=1) + np.tensordot(punishments[0], punishments[1], axes=1)
    epsilon = 0.0 if rule.rescue else rule.epsilon
    return Drift(push, epsilon * np.asarray(shares.grown, dtype=np.float64))


def shares_of(
    sim: neuro.Simulation,
    projection: str,
    times: ArrayLike,
    ids: ArrayLike,
    offsets: ArrayLike,
    labels: ArrayLike,
    results: neuro.TrialResults,
) -> Shares:
    """Count in which share of a batch of trials each weight of a grid was taught.

    Args:
        sim: what was taught.
        projection: a grid from the input of the trials to their output, without padding.
        times: of the spikes that `sim.trials` was shown, ms.
        ids: their inputs.
        offsets: where the spikes of each trial begin, and the end.
        labels: of the trials.
        results: how the trials ended.

    Returns:
        Shares in the shape of the kernels, (maps, channels, height, width).

    Raises:
        ModelError: the projection is none such, or its rule is not `r_stdp` without `rescue`: results do not name the
            neurons that were rescued.
    """
    program = sim.program
    part = next((each for each in program.projections if each.name == projection), None)
    grid, trials = None if part is None else part.grid, program.trials
    rule = None if part is None else part.synapse
    if part is None or grid is None or trials is None or not isinstance(rule, neuro.r_stdp) or rule.rescue:
        raise ModelError(f"shares_of: '{projection}': expected a grid that learns by r_stdp in trials, without rescue")
    if grid.top or grid.left or grid.depthwise or part.source != trials.input:
        raise ModelError(f"shares_of: '{projection}': expected a grid from the input of the trials, without padding")
    shown, ends = np.round(np.asarray(times) / program.resolution).astype(np.int64), np.asarray(offsets)
    maps, _, height, width = grid.kernels
    counts = np.zeros((2, 3, *grid.kernels))
    grown = np.zeros(maps)
    sheet = np.empty(program.populations[part.source].size)
    for k, right in enumerate(np.asarray(labels).tolist()):
        winner, hit = int(results.winner[k]), int(results.label[k]) == right
        if not hit:
            grown[right * trials.maps_per_label : (right + 1) * trials.maps_per_label] += 1.0
        if winner < 0 or trials.reward[0 if hit else 1] == 0.0:
            continue
        sheet.fill(np.inf)
        span = slice(ends[k], ends[k + 1])
        np.minimum.at(sheet, np.asarray(ids)[span], shown[span] + int(part.delay[0]))
        at, place = divmod(winner, grid.rows * grid.columns)
        y, x = (grid.stride * each for each in divmod(place, grid.columns))
        field = sheet.reshape(grid.channels, grid.height, grid.width)[:, y : y + height, x : x + width]
        order = 1 + np.sign(field - results.step[k]).astype(np.int64)
        punished = int(trials.reward[0 if hit else 1] < 0.0)
        np.add.at(counts, (punished, order, at, *np.indices(field.shape)), 1.0)
    n = max(len(results), 1)
    every = np.broadcast_to(grown.reshape(-1, 1, 1, 1) / n, grid.kernels)
    return Shares(counts[0] / n, counts[1] / n, every)


def needed(rule: neuro.r_stdp, weight: Floats, before: float, per_label: int) -> float:
    """Return the share of trials that must be right, so that epsilon does not outweigh rewards and punishments.

    All maps win equally often, and each input comes before a decision with the same probability.

    Args:
        rule: `r_stdp` without `rescue`.
        weight: the weights.
        before: the probability.
        per_label: maps of a label.
    """
    drifts = _of_outcomes(rule, before)
    right, wrong = (float(np.mean(each.push * weight * (1.0 - weight))) / per_label for each in drifts)
    up = wrong + rule.epsilon
    return 0.0 if up <= 0.0 else up / (up - right) if right < 0.0 else 1.0


def sufficient_epsilon(rule: neuro.r_stdp, weight: Floats, before: float, per_label: int, share: float) -> float:
    """Return the epsilon at which `needed` is a share; 0 where there is none."""
    drifts = _of_outcomes(rule, before)
    right, wrong = (float(np.mean(each.push * weight * (1.0 - weight))) / per_label for each in drifts)
    return max(0.0, -right * share / (1.0 - share) - wrong)


def _of_outcomes(rule: neuro.r_stdp, before: float) -> list[Drift]:
    """Drifts in a trial that is rewarded, and in one that is punished."""
    came, never = np.array([before, 0.0, 1.0 - before]), np.zeros(3)
    return [drift_of(rule, Shares(*each)) for each in ((came, never, never[0]), (never, came, never[0]))]


def findings(wiring: Wiring) -> Iterator[Finding]:
    """Findings about weights that epsilon drives to Wmax, or that nothing brings back, before anything runs."""
    program, trials = wiring.program, wiring.program.trials
    if trials is None or not 0 < trials.maps_per_label < trials.maps or not trials.reward[0] > 0.0 > trials.reward[1]:
        return
    chance = trials.maps_per_label / trials.maps
    limit = chance + EARLY * (1.0 - chance)
    for q, part in enumerate(program.projections):
        rule, cell = part.synapse, wiring.cell(part.target)
        if not isinstance(rule, neuro.r_stdp) or rule.rescue or cell is None:
            continue
        if rule.epsilon == 0.0:
            if rule.Ap_minus < 0.0 < rule.Ar_plus and (alive := rule.Ap_minus / (rule.Ap_minus - rule.Ar_plus)) > limit:
                evidence = (
                    f"inputs that bring a map to its decision lose weight unless {alive:.0%} of its decisions are "
                    "right; with epsilon = 0 and without rescue a map that has become silent is not taught any more"
                )
                yield warning("maps-die", part, evidence, "set epsilon to 0.0002 or rescue: true, or lower -Ap_minus")
            continue
        span = rule.Wmax - rule.Wmin
        weight = np.clip((part.weight - rule.Wmin) / span, 0.0, 1.0)
        drive = cell.slope(0) * wiring.pushes(q)[0] / program.populations[part.target].size
        if drive <= 0.0 or not weight.size:
            continue
        before = min(1.0, cell.distance / drive)
        share = needed(rule, weight, before, trials.maps_per_label)
        if share <= limit:
            continue
        reach = chance + EARLY_AT_MOST * (1.0 - chance)
        soon = (1.0 - float(weight.mean())) / (rule.epsilon * chance * (1.0 - chance))
        by_chance = (
            f"by chance epsilon brings a mean weight to Wmax in {figure(soon)} trials, and then all maps decide alike"
        )
        early = f"at this chance ReMuS on N-MNIST has {limit:.0%} to {reach:.0%} right early: weights may saturate"
        evidence = (
            f"epsilon = {rule.epsilon:g} outweighs rewards and punishments until {share:.0%} of the trials are right, "
            f"of which chance is {chance:.0%}; {by_chance if share > reach else early}"
        )
        least, most = (sufficient_epsilon(rule, weight, before, trials.maps_per_label, end) for end in (limit, reach))
        lower = f"lower epsilon to about {figure(least)}" if least > 0.0 else "set epsilon to 0"
        lower += f", or at most {figure(most)} if decisions are right early" if most > 0.0 else ""
        yield warning("weights-saturate", part, evidence, f"{lower}, or set rescue: true")
