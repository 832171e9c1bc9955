"""Expected drift of weights under `r_stdp`, from the outcomes of trials and the times of inputs.

Weights are scaled so that Wmin is 0 and Wmax is 1. docs/explanation/recognisers.md derives the formulas.
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
"""Smallest and largest accuracy before epsilon has raised the weights, scaled so that chance is 0 and 100 % is 1.

ReMuS on N-MNIST reaches 0.24 to 0.27 in the first 1000 trials at a threshold of 30, and 0.37 to 0.58 at 60, depending
on the recordings: docs/explanation/recognisers.md.
"""


class Shares(NamedTuple):
    """Shares of all trials in which weights are updated.

    Attributes:
        rewarded: (3, ...), share of trials in which the weight's neuron was rewarded and its input came before, at, or
            after the decision; a silent input counts as after.
        punished: (3, ...), the same for trials in which the neuron was punished.
        grown: (...), share of wrong or silent trials with the label of the weight's map.
    """

    rewarded: Floats
    punished: Floats
    grown: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The expected change of a weight w per trial, push w (1 - w) + lift.

    Attributes:
        push: mean rate of rewards and punishments per trial.
        lift: growth by epsilon per trial, >= 0.
    """

    push: Floats
    lift: Floats

    def change(self, weight: ArrayLike) -> Floats:
        """Return the expected change of a weight per trial; bounds are ignored."""
        w = np.asarray(weight, dtype=np.float64)
        return self.push * w * (1.0 - w) + self.lift

    def fixed_points(self) -> tuple[Floats, Floats]:
        """Return the stable weight, and the weight above which weights drift to the upper bound.

        If the push is not negative, or the lift is above |push| / 4, all weights end at the upper bound: the results
        are 1 and 0. If push and lift are 0, nothing drifts: the results are NaN.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            discriminant = 1.0 + 4.0 * self.lift / self.push
            gap = np.sqrt(np.where((self.push < 0.0) & (discriminant >= 0.0), discriminant, np.nan))
        no_drift = (self.push == 0.0) & (self.lift == 0.0)
        ends = [np.where(np.isnan(gap), end, (1.0 + sign * gap) / 2.0) for sign, end in ((-1.0, 1.0), (1.0, 0.0))]
        low, high = (np.where(no_drift, np.nan, point) for point in ends)
        return low, high

    def after(self, weight: ArrayLike, trials: ArrayLike) -> Floats:
        """Return the weight after a number of trials with the same shares: the solution of dw/dn = `change`, at most 1.

        With w = u / v the equation is linear: u' = (push u) / 2 + lift v, v' = push u - (push v) / 2.
        """
        w, n = np.asarray(weight, dtype=np.float64), np.asarray(trials, dtype=np.float64)
        half_push = self.push / 2.0
        square = self.push * (self.push / 4.0 + self.lift)
        s, rise, fall = np.sqrt(np.abs(square)), half_push * w + self.lift, half_push - self.push * w
        q = np.exp(-2.0 * s * n)  # u and v are scaled by exp(-s n) to stay finite for large n
        hyperbolic = (s * w + rise) + q * (s * w - rise), (s - fall) + q * (s + fall)
        circular = s * w * np.cos(s * n) + rise * np.sin(s * n), s * np.cos(s * n) - fall * np.sin(s * n)
        straight = w + n * rise, 1.0 - n * fall
        # For small s n the linear solution is used, since the others lose digits there.
        cases = [(square > 0.0) & (s * n > 1e-6), (square < 0.0) & (s * n > 1e-6)]
        u = np.select(cases, [hyperbolic[0], circular[0]], straight[0])
        v = np.select(cases, [hyperbolic[1], circular[1]], straight[1])
        # Without a fixed point u / v passes infinity and returns from below. The weight reaches 1 before that.
        n_at_bound = np.arctan2(s * (1.0 - w), self.lift + half_push * (1.0 - w))  # times s
        at_bound = (v <= 0.0) | ((square < 0.0) & (s * n >= n_at_bound))
        with np.errstate(divide="ignore", invalid="ignore"):
            result: Floats = np.where(at_bound, 1.0, np.clip(u / v, 0.0, 1.0))
        return np.where((w == 0.0) & (self.lift == 0.0), 0.0, result)

    def saturating_epsilon(self, weight: ArrayLike, grown: ArrayLike) -> Floats:
        """Return the epsilon above which a weight ends at the upper bound.

        Args:
            weight: initial weight.
            grown: share of the trials in which epsilon is added, see `Shares`.
        """
        w = np.asarray(weight, dtype=np.float64)
        # A weight below 1/2 passes w = 1/2, where the push is strongest.
        factor = np.where(w > 0.5, w * (1.0 - w), 0.25)
        epsilon: Floats = np.maximum(-self.push, 0.0) * factor / np.asarray(grown, dtype=np.float64)
        return epsilon


def drift_of(rule: neuro.r_stdp, shares: Shares) -> Drift:
    """Return the drift of weights under `r_stdp`. With `rescue`, rescued trials count as rewarded."""
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
    """Return the shares of a batch of trials in which each weight of a grid was updated.

    Args:
        sim: simulation that ran the trials.
        projection: name of a grid from the input of the trials to their output, without padding.
        times: spike times given to `sim.trials`, ms.
        ids: input neurons of these spikes.
        offsets: index of each trial's first spike, and the number of spikes at the end.
        labels: labels of the trials.
        results: results of the trials.

    Returns:
        Shares in the shape of the kernels, (maps, channels, height, width).

    Raises:
        ModelError: the projection is no such grid, does not learn by `r_stdp`, or learns with `rescue`, since results
            do not name rescued neurons.
    """
    program = sim.program
    part = next((p for p in program.projections if p.name == projection), None)
    grid, trials = None if part is None else part.grid, program.trials
    rule = None if part is None else part.synapse
    if part is None or grid is None or trials is None or not isinstance(rule, neuro.r_stdp) or rule.rescue:
        raise ModelError(f"shares_of: '{projection}': expected a grid that learns by r_stdp in trials, without rescue")
    if grid.top or grid.left or grid.depthwise or part.source != trials.input:
        raise ModelError(f"shares_of: '{projection}': expected a grid from the input of the trials, without padding")
    steps, starts = np.round(np.asarray(times) / program.resolution).astype(np.int64), np.asarray(offsets)
    maps, _, height, width = grid.kernels
    counts = np.zeros((2, 3, *grid.kernels))
    grown = np.zeros(maps)
    arrivals = np.empty(program.populations[part.source].size)
    for k, label in enumerate(np.asarray(labels).tolist()):
        winner, hit = int(results.winner[k]), int(results.label[k]) == label
        if not hit:
            grown[label * trials.maps_per_label : (label + 1) * trials.maps_per_label] += 1.0
        if winner < 0 or trials.reward[0 if hit else 1] == 0.0:
            continue
        arrivals.fill(np.inf)
        span = slice(starts[k], starts[k + 1])
        np.minimum.at(arrivals, np.asarray(ids)[span], steps[span] + int(part.delay[0]))
        winning_map, position = divmod(winner, grid.rows * grid.columns)
        y, x = (grid.stride * side for side in divmod(position, grid.columns))
        field = arrivals.reshape(grid.channels, grid.height, grid.width)[:, y : y + height, x : x + width]
        order = 1 + np.sign(field - results.step[k]).astype(np.int64)
        punished = int(trials.reward[0 if hit else 1] < 0.0)
        np.add.at(counts, (punished, order, winning_map, *np.indices(field.shape)), 1.0)
    n = max(len(results), 1)
    grown_shares = np.broadcast_to(grown.reshape(-1, 1, 1, 1) / n, grid.kernels)
    return Shares(counts[0] / n, counts[1] / n, grown_shares)


def required_share(rule: neuro.r_stdp, weight: Floats, before: float, per_label: int) -> float:
    """Return the share of right trials above which epsilon does not outweigh rewards and punishments.

    Assumes that all maps win equally often, and that each input comes before a decision with the same probability.

    Args:
        rule: `r_stdp` without `rescue`.
        weight: the weights.
        before: probability that an input comes before a decision.
        per_label: maps per label.
    """
    drifts = _outcome_drifts(rule, before)
    push_correct, push_wrong = (float(np.mean(drift.push * weight * (1.0 - weight))) / per_label for drift in drifts)
    gain = push_wrong + rule.epsilon
    return 0.0 if gain <= 0.0 else gain / (gain - push_correct) if push_correct < 0.0 else 1.0


def sufficient_epsilon(rule: neuro.r_stdp, weight: Floats, before: float, per_label: int, share: float) -> float:
    """Return the epsilon for which `required_share` is `share`; 0 if there is none."""
    drifts = _outcome_drifts(rule, before)
    right, wrong = (float(np.mean(drift.push * weight * (1.0 - weight))) / per_label for drift in drifts)
    return max(0.0, -right * share / (1.0 - share) - wrong)


def _outcome_drifts(rule: neuro.r_stdp, before: float) -> list[Drift]:
    """Return the drift in a rewarded trial, and in a punished trial; `before` as for `required_share`."""
    shares, zeros = np.array([before, 0.0, 1.0 - before]), np.zeros(3)
    return [drift_of(rule, Shares(*arguments)) for arguments in ((shares, zeros, zeros[0]), (zeros, shares, zeros[0]))]


def findings(wiring: Wiring) -> Iterator[Finding]:
    """Yield findings about maps that become silent and weights that epsilon drives to Wmax, without a simulation."""
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
            if (
                rule.Ap_minus < 0.0 < rule.Ar_plus
                and (least_right := rule.Ap_minus / (rule.Ap_minus - rule.Ar_plus)) > limit
            ):
                evidence = (
                    f"inputs that bring a map to its decision lose weight unless {least_right:.0%} of its decisions "
                    "are right; with epsilon = 0 and without rescue a map that has become silent is not taught any more"
                )
                yield warning("maps-die", part, evidence, "set epsilon to 0.0002 or rescue: true, or lower -Ap_minus")
            continue
        span = rule.Wmax - rule.Wmin
        weight = np.clip((part.weight - rule.Wmin) / span, 0.0, 1.0)
        drive = cell.slope(0) * wiring.pushes(q)[0] / program.populations[part.target].size
        if drive <= 0.0 or not weight.size:
            continue
        p_pre = min(1.0, cell.distance / drive)
        share = required_share(rule, weight, p_pre, trials.maps_per_label)
        if share <= limit:
            continue
        high_limit = chance + EARLY_AT_MOST * (1.0 - chance)
        n_trials = (1.0 - float(weight.mean())) / (rule.epsilon * chance * (1.0 - chance))
        by_chance = (
            f"by chance epsilon brings a mean weight to Wmax in {figure(n_trials)} trials, "
            "and then all maps decide alike"
        )
        saturation = (
            f"at this chance ReMuS on N-MNIST has {limit:.0%} to {high_limit:.0%} right early: weights may saturate"
        )
        evidence = (
            f"epsilon = {rule.epsilon:g} outweighs rewards and punishments until {share:.0%} of the trials are right, "
            f"of which chance is {chance:.0%}; {by_chance if share > high_limit else saturation}"
        )
        low, upper = (
            sufficient_epsilon(rule, weight, p_pre, trials.maps_per_label, end) for end in (limit, high_limit)
        )
        lower = f"lower epsilon to about {figure(low)}" if low > 0.0 else "set epsilon to 0"
        lower += f", or at most {figure(upper)} if decisions are right early" if upper > 0.0 else ""
        yield warning("weights-saturate", part, evidence, f"{lower}, or set rescue: true")
