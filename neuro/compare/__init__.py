"""Comparison of one network on several backends: differences of spikes, weights, counts and joules from the first."""

from neuro.compare.loihi_rules import LoihiRules, RuleDifference, loihi_rules
from neuro.compare.result import Bill, Comparison, Run
from neuro.compare.runs import compare

__all__ = ["Bill", "Comparison", "LoihiRules", "RuleDifference", "Run", "compare", "loihi_rules"]
