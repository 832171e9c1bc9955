"""Comparison of a network on several backends with the first: spikes, weights, counts and energy."""

from neuro.compare.loihi_rules import LoihiRules, RuleDifference, loihi_rules
from neuro.compare.result import Bill, Comparison, Run
from neuro.compare.runs import compare

__all__ = ["Bill", "Comparison", "LoihiRules", "RuleDifference", "Run", "compare", "loihi_rules"]
