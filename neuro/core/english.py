"""Words in messages."""

from __future__ import annotations


def a(name: str) -> str:
    """A name behind its article: "a poisson_generator", "an iaf_psc_exp"."""
    return f"{'an' if name[:1].lower() in 'aeio' else 'a'} {name}"


def some(n: int, noun: str) -> str:
    """A number of something: "1 synapse", "1,000 synapses"."""
    return f"{n:,} {noun}{'s' * (n != 1)}"
