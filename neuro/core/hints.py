"""Ways out of common mistakes: names used elsewhere in the field, and values in another notation."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

# Words of other simulators, papers and habits -> ours; only those that are known at the place are suggested.
ELSEWHERE: dict[str, tuple[str, ...]] = {
    # sections and their words
    "source": ("from",),
    "src": ("from",),
    "pre": ("from",),
    "post": ("to",),
    "dst": ("to",),
    "target": ("to", "of"),
    "population": ("of",),
    "conn_spec": ("rule",),
    "connectivity": ("rule",),
    "connector": ("rule",),
    "syn_spec": ("synapse",),
    "synapse_model": ("synapse",),
    "synapse_type": ("synapse",),
    "plasticity": ("synapse",),
    "learning_rule": ("synapse",),
    "w": ("weight",),
    "size": ("shape",),
    "n": ("shape",),
    "count": ("shape",),
    "neuron": ("model",),
    "cell": ("model",),
    "cellclass": ("model",),
    "type": ("model", "rule", "synapse"),
    "variable": ("record",),
    "interval": ("every",),
    "dt": ("resolution", "every"),
    "timestep": ("resolution",),
    "edge_wrap": ("periodic",),
    "wrap": ("periodic",),
    "pos": ("positions",),
    "coordinates": ("positions",),
    "version": ("neuro",),
    "title": ("name",),
    "neurons": ("populations",),
    "nodes": ("populations",),
    "layers": ("populations",),
    "connections": ("projections",),
    "synapses": ("projections",),
    "edges": ("projections",),
    "recorders": ("probes",),
    "monitors": ("probes",),
    "detectors": ("probes",),
    "params": ("parameters",),
    "variables": ("parameters",),
    "imports": ("include",),
    # parameters
    "tau": ("tau_m", "tau_plus", "tau_c"),
    "tau_mem": ("tau_m",),
    "v_rest": ("E_L",),
    "e_rest": ("E_L",),
    "el": ("E_L",),
    "v_thresh": ("V_th",),
    "v_threshold": ("V_th",),
    "threshold": ("V_th",),
    "theta": ("V_th",),
    "v_peak": ("V_th",),
    "v_init": ("V_m",),
    "v": ("V_m",),
    "u": ("U_m",),
    "cm": ("C_m",),
    "tau_ref": ("t_ref",),
    "tau_refrac": ("t_ref",),
    "refractory": ("t_ref",),
    "refractory_period": ("t_ref",),
    "i_offset": ("I_e",),
    "current": ("I_e", "amplitude"),
    "tau_syn_e": ("tau_syn_ex",),
    "tau_syn_i": ("tau_syn_in",),
    "tau_syn": ("tau_syn_ex", "tau_syn_in"),
    "exc": ("ex",),
    "excitatory": ("ex",),
    "inh": ("in",),
    "inhibitory": ("in",),
    "receptor_type": ("receptor",),
    "frequency": ("rate",),
    "freq": ("rate",),
    "times": ("spike_times",),
    "learning_rate": ("lambda",),
    "eta": ("lambda",),
    "mu": ("mean", "mu_plus", "mu_minus"),
    "sigma": ("std",),
    "p_center": ("a",),
    "p_max": ("a",),
    "sd": ("std",),
    "min": ("low", "Wmin"),
    "max": ("high", "Wmax"),
    "indegree": ("n",),
    "outdegree": ("n",),
    "probability": ("p",),
    "size_kernel": ("kernel",),
    "allow_autapses": ("autapses",),
    "allow_multapses": ("multapses",),
    # names of choices
    "lif": ("iaf_psc_delta", "iaf_psc_exp", "iaf_psc_alpha"),
    "iaf": ("iaf_psc_delta", "iaf_psc_exp", "iaf_psc_alpha"),
    "if_curr_exp": ("iaf_psc_exp",),
    "if_curr_alpha": ("iaf_psc_alpha",),
    "if_curr_delta": ("iaf_psc_delta",),
    "parrot": ("parrot_neuron",),
    "poisson": ("poisson_generator",),
    "spikesourcepoisson": ("poisson_generator",),
    "poissongroup": ("poisson_generator",),
    "spikesourcearray": ("spike_generator",),
    "spikegeneratorgroup": ("spike_generator",),
    "dcsource": ("dc_generator",),
    "acsource": ("ac_generator",),
    "noisycurrentsource": ("noise_generator",),
    "stepcurrentsource": ("step_current_generator",),
    "dense": ("all_to_all",),
    "full": ("all_to_all",),
    "fully_connected": ("all_to_all",),
    "conv": ("grid",),
    "conv2d": ("grid",),
    "convolution": ("grid",),
    "random": ("pairwise_bernoulli", "uniform"),
    "fixed_probability": ("pairwise_bernoulli",),
    "explicit": ("pairs",),
    "list": ("pairs",),
    "stdp_dopamine_synapse": ("stdp_dopa",),
    "rstdp": ("r_stdp", "mstdpet"),
    "encoder": ("encode",),
    "encoding": ("code", "encode"),
    "coding": ("code", "encode"),
    "i2l": ("intensity_to_latency",),
    "latency": ("intensity_to_latency", "log_intensity_to_latency"),
    "ttfs": ("intensity_to_latency", "log_intensity_to_latency"),
    "log_i2l": ("log_intensity_to_latency",),
    "rank_order": ("rank",),
    "gaussian": ("normal",),
    "circle": ("circular",),
    "spherical": ("circular",),
    "box": ("rectangular",),
    "gauss": ("normal",),
    "wta": ("winner_take_all",),
}

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_MAX_LISTED = 12
_MICRO = ("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}")


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint that names the nearest of `known`, or all of them when none is near."""
    names = sorted(known)
    if not names:
        return "none is defined"
    if close := alike(name, names):
        return "did you mean " + " or ".join(f"'{word}'" for word in close) + "?"
    more = ", ..." if len(names) > _MAX_LISTED else ""
    return "known: " + ", ".join(names[:_MAX_LISTED]) + more


def near(name: str, known: Iterable[str]) -> str:
    """A hint that names the nearest of `known`, "" when none is near."""
    names = sorted(known)
    return nearest(name, names) if alike(name, names) else ""


def alike(name: str, names: Sequence[str]) -> list[str]:
    """The nearest of some names, in the order of the alphabet; none if none is near."""
    return [word for word in ELSEWHERE.get(name.lower(), ()) if word in names] or _similar(name, list(names))


def _similar(name: str, names: list[str]) -> list[str]:
    """The names that look most alike, whatever their case; else those that begin or end alike."""
    lower = name.lower()
    folded: dict[str, list[str]] = {}
    for word in names:
        folded.setdefault(word.lower(), []).append(word)
    close = difflib.get_close_matches(lower, folded, n=3)
    if close:
        best = difflib.SequenceMatcher(None, close[0], lower).ratio()
        alike = [c for c in close if difflib.SequenceMatcher(None, c, lower).ratio() == best]
        return sorted(word for c in alike for word in folded[c])
    if len(name) < 3:
        return []
    parts = [word for word in names if word.lower().startswith(lower) or lower.startswith(word.lower() + "_")]
    return parts if len(parts) <= 3 else []


def notation(text: str) -> str:
    """How to write the number that a piece of text seems to mean, or "".

    Args:
        text: what stands where a number is expected, e.g. "10 ms".
    """
    word = text.strip()
    if decimal := _decimal(word):
        return decimal
    if _NUMBER.fullmatch(word):
        return f"write {word} without quotes"
    if _NUMBER.fullmatch(word.replace("_", "")):
        return f"write {word.replace('_', '')}"
    if re.fullmatch(r"[-+]?\d+,\d+", word):
        return f"write {word.replace(',', '.')}"
    if word.lower().lstrip("+-.") in ("inf", "infinity"):
        return f"write {'-' if word[0] == '-' else ''}.inf"
    number = _NUMBER.match(word)
    if number is None:
        return ""
    rest = word[number.end() :].strip()
    if rest[:1] in _MICRO and rest[1:].isalpha() and rest[1:].isascii():
        return f"write {number[0]} u{rest[1:]}"
    if rest == "%":
        return f"write {float(number[0]) / 100!r}"
    if re.search(r"[-+*/()\d]", rest.lstrip("* ")):
        return f"write $({word}) in YAML, or the result"
    return ""


def _decimal(word: str) -> str:
    """How to write a hexadecimal, octal or binary number, or ""."""
    if not re.fullmatch(r"0(x[0-9a-f]+|o[0-7]+|b[01]+)", word.lower()):
        return ""
    return f"write {int(word, 0)}: numbers here are decimal"


def axes(text: str) -> str:
    """How to write the sizes that a piece of text seems to mean, e.g. "8x8", or ""."""
    if decimal := _decimal(text.strip()):
        return decimal
    sizes = re.findall(r"\d+", text)
    if sizes and re.fullmatch(r"[\s\d(),x*]+", text):
        return f"write [{', '.join(sizes)}]"
    return ""
