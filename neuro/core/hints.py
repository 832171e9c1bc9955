"""Hints for common mistakes: names used elsewhere in the field, and values in another notation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

# Words of other simulators and papers for each word of this package. A hint suggests only words valid at its place.
_OTHERS = {
    "from": "source src pre",
    "source": "pre src from",
    "to": "post dst target",
    "target": "post dst to",
    "of": "target population",
    "model": "neuron cell cellclass type",
    "rule": "conn_spec connectivity connector type connect",
    "synapse": "syn_spec synapse_model synapse_type plasticity learning_rule type syn_model",
    "weight": "w",
    "shape": "size n count num_neurons n_neurons num number",
    "record": "variable variables record_from",
    "resolution": "dt timestep",
    "every": "interval dt",
    "periodic": "edge_wrap wrap",
    "positions": "pos coordinates",
    "neuro": "version",
    "name": "title",
    "populations": "neurons nodes layers",
    "projections": "connections synapses edges synapse connect",
    "probes": "recorders monitors detectors spike_recorder multimeter voltmeter weight_recorder spikemonitor "
    "statemonitor monitor devices",
    "parameters": "params variables",
    "include": "imports",
    "tau_m": "tau tau_mem taum tau_mem_inv tc_decay beta dv",
    "tau_plus": "tau taupre tc_pre tau_pre",
    "tau_c": "tau",
    "E_L": "v_rest e_rest el v_leak rest vl",
    "V_th": "v_thresh v_threshold threshold theta v_peak thresh vth",
    "V_m": "v_init v",
    "U_m": "u",
    "C_m": "cm",
    "t_ref": "tau_ref tau_refrac refractory refractory_period refrac",
    "I_e": "i_offset current bias bias_mant i_ext",
    "amplitude": "current",
    "tau_syn_ex": "tau_syn_e tau_syn tau_syn_inv alpha du",
    "tau_syn_in": "tau_syn_i tau_syn tau_syn_inv",
    "ex": "exc excitatory",
    "in": "inh inhibitory",
    "receptor": "receptor_type",
    "rate": "frequency freq firing_rate rates",
    "spike_times": "times",
    "lambda": "learning_rate eta nu a_pre apre a_plus",
    "mean": "mu",
    "mu_plus": "mu",
    "mu_minus": "mu",
    "std": "sigma sd",
    "a": "p_center p_max",
    "low": "min",
    "Wmin": "min w_min wmin",
    "high": "max",
    "Wmax": "max w_max wmax gmax",
    "n": "indegree outdegree k fan_in fan_out",
    "p": "probability connection_probability epsilon prob",
    "kernel": "size_kernel",
    "autapses": "allow_autapses",
    "multapses": "allow_multapses",
    "iaf_psc_delta": "lif iaf if_curr_delta leaky lapicque lifnodes ifnodes lifcell lifboxcell rleaky",
    "iaf_psc_exp": "lif iaf if_curr_exp synaptic currentlifnodes lifcell rsynaptic",
    "iaf_psc_alpha": "lif iaf if_curr_alpha iaf_neuron alpha",
    "parrot_neuron": "parrot",
    "poisson_generator": "poisson spikesourcepoisson poissongroup poissoninput poissonencoder",
    "spike_generator": "spikesourcearray spikegeneratorgroup ringbuffer",
    "dc_generator": "dcsource dc",
    "ac_generator": "acsource",
    "noise_generator": "noisycurrentsource",
    "step_current_generator": "stepcurrentsource",
    "all_to_all": "dense full fully_connected alltoallconnector",
    "grid": "conv conv2d convolution conv1d convolutionconnector kernelconnector",
    "pairwise_bernoulli": "random fixed_probability fixedprobabilityconnector",
    "uniform": "random",
    "pairs": "explicit list fromlistconnector sparse",
    "stdp_dopa": "stdp_dopamine_synapse",
    "r_stdp": "rstdp",
    "mstdpet": "rstdp mstdp",
    "code": "encoding coding",
    "encode": "encoder encoding coding",
    "intensity_to_latency": "i2l latency ttfs",
    "log_intensity_to_latency": "latency ttfs log_i2l",
    "rank": "rank_order",
    "normal": "gaussian gauss",
    "circular": "circle spherical",
    "rectangular": "box",
    "winner_take_all": "wta",
    "alpha": "a_minus a_post apost",
    "tsodyks2": "tsodyksmarkramsynapse",
    "stdp": "postpre stdpmechanism spikepairrule hebbian stdploihi stdp_synapse",
    "static": "static_synapse staticsynapse",
    "distance_dependent": "distancedependentprobabilityconnector",
    "from_file": "fromfileconnector",
    "fixed_total_number": "fixedtotalnumberconnector fixed_total",
    "fixed_outdegree": "fixednumberpostconnector",
    "fixed_indegree": "fixednumberpreconnector",
    "one_to_one": "onetooneconnector",
    "mat2_psc_exp": "mat",
    "izhikevich": "izhikevichnodes",
    "srm0": "srm0nodes",
    "iaf_psc_exp_adaptive_threshold": "adaptivelifnodes diehlandcooknodes lsnn lsnncell alif",
    "aeif_cond_exp": "eif_cond_exp_isfa_ista adex",
    "iaf_cond_alpha": "if_cond_alpha",
    "iaf_cond_exp": "if_cond_exp",
    "cuba_lif": "synaptic",
    "hh_psc_alpha": "hh_cond_exp hh_cond_exp_traub hodgkin_huxley hh",
    "A_minus": "a_post apost",
    "A_plus": "a_pre apre",
    "reset_by_subtraction": "reset_mechanism",
    "tau_theta": "tc_theta_decay",
    "theta_plus": "dtheta",
    "V_reset": "reset vr",
    "tau_minus": "taupost tc_post tau_post",
    "for": "duration time simtime run_time",
    "chip": "target backend",
    "chips": "target targets",
    "html": "page",
    "backend": "simulator engine",
    "backends": "backend simulator target",
    "run": "simulate",
    "set": "param params parameter",
    "threads": "n_threads num_threads local_num_threads",
    "workers": "jobs n_jobs processes",
    "share": "part",
    "preset": "settings",
    "repeats": "seeds trials",
}
ELSEWHERE: dict[str, tuple[str, ...]] = {}
"""Words of this package by the word of another tool."""
for _ours, _words in _OTHERS.items():
    for _word in _words.split():
        ELSEWHERE[_word] = (*ELSEWHERE.get(_word, ()), _ours)

# Words of other tools without a counterpart here, by their hint.
_WITHOUT = {
    "spikes are recorded without a device; 'probes' (YAML) or net.probe (Python) records the rest": "spike_recorder "
    "spike_detector multimeter voltmeter weight_recorder correlation_detector spin_detector spikemonitor statemonitor "
    "populationratemonitor record",
    "dopamine is a signal, or the spikes of a population: neuro models stdp_dopa": "volume_transmitter",
    "write sim = neuro.compile(net), then sim.run(100.0); for a file neuro run FILE --for 100": "run simulate",
    "write net.population(name, shape, model), in YAML name: {shape: 3, model: iaf_psc_exp} in 'populations'": (
        "create population neurongroup ensemble"
    ),
    "write net.connect(source, target, rule), in YAML {from: source, to: target, rule: all_to_all} in 'projections'": (
        "connect projection connection synapses"
    ),
    "set it when the network runs: neuro run FILE --for 100, or sim.run(100.0)": "duration simtime run_time",
    "set it when the network runs: neuro run FILE --seed 1, or neuro.compile(net, seed=1)": "seed rng_seed",
    "set it when the network runs: neuro run FILE --threads 2, or neuro.compile(net, threads=2)": "threads",
    "the resistance is tau_m / C_m": "r r_m r_in",
    "the leak conductance is C_m / tau_m": "g_l gl g_leak",
    "write the initial value of a state in 'initial', beside the model": "v_m v_init v0",
    "write {name: {parameter: value}}": "params parameters cellparams",
    "weight and delay are words of a projection, beside its synapse": "weight delay",
    "write synapse: {static: {receptor: ex}}": "receptor receptor_type",
}
INSTEAD: dict[str, str] = {}
"""Hint by the word of another tool, for words that `ELSEWHERE` lacks."""
for _hint, _words in _WITHOUT.items():
    for _word in _words.split():
        INSTEAD[_word] = _hint

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_MAX_LISTED = 12
_MICRO = ("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}")


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint with the nearest of the known names, or with all names if none is near."""
    names = sorted(known)
    if not names:
        return "none is defined"
    if close := close_names(name, names):
        return "did you mean " + " or ".join(f"'{word}'" for word in close) + "?"
    if name.lower() in INSTEAD:
        return INSTEAD[name.lower()]
    ellipsis = ", ..." if len(names) > _MAX_LISTED else ""
    return "known: " + ", ".join(names[:_MAX_LISTED]) + ellipsis


def near(name: str, known: Iterable[str]) -> str:
    """Return a hint with the nearest of the known names; "" if none is near."""
    names = sorted(known)
    return nearest(name, names) if close_names(name, names) or name.lower() in INSTEAD else ""


def close_names(name: str, names: Sequence[str]) -> list[str]:
    """Return the names most similar to a name, in alphabetical order; [] if none is similar."""
    lower = name.lower()
    close = [word for word in ELSEWHERE.get(lower, ()) if word in names] or [
        w for w in names if w.lower() in (lower, f"{lower}s")
    ]
    return close if close or lower in INSTEAD else _similar(name, list(names))


def _similar(name: str, names: list[str]) -> list[str]:
    """Return the most similar names, ignoring case; if there are none, those with the same beginning."""
    import difflib

    lower = name.lower()
    folded: dict[str, list[str]] = {}
    for word in names:
        folded.setdefault(word.lower(), []).append(word)
    close = difflib.get_close_matches(lower, folded, n=3)
    if close:
        best_ratio = difflib.SequenceMatcher(None, close[0], lower).ratio()
        best_names = [match for match in close if difflib.SequenceMatcher(None, match, lower).ratio() == best_ratio]
        return sorted(word for match in best_names for word in folded[match])
    if len(name) < 3:
        return []
    same_beginning = [word for word in names if word.lower().startswith(lower) or lower.startswith(word.lower() + "_")]
    return same_beginning if len(same_beginning) <= 3 else []


def notation(text: str) -> str:
    """Return a hint on how to write the number in a text, e.g. "write 10 us" for "10µs"; "" for no hint.

    Args:
        text: text in place of a number, e.g. "10 ms".
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
    remainder = word[number.end() :].strip()
    if remainder[:1] in _MICRO and remainder[1:].isalpha() and remainder[1:].isascii():
        return f"write {number[0]} u{remainder[1:]}"
    if unit := re.fullmatch(r"\*\s*([A-Za-z]+)", remainder):
        return f"write {number[0]} {unit[1]}"
    if remainder == "%":
        return f"write {float(number[0]) / 100!r}"
    if re.search(r"[-+*/()\d]", remainder.lstrip("* ")):
        return f"write $({word}) in YAML, or the result"
    return ""


def _decimal(word: str) -> str:
    """Return a hint for a hexadecimal, octal or binary number, or ""."""
    if not re.fullmatch(r"0(x[0-9a-f]+|o[0-7]+|b[01]+)", word.lower()):
        return ""
    return f"write {int(word, 0)}: numbers here are decimal"


def axes(text: str) -> str:
    """Return a hint on how to write sizes, e.g. "write [8, 8]" for "8x8"; "" for no hint."""
    if decimal := _decimal(text.strip()):
        return decimal
    sizes = re.findall(r"\d+", text)
    if sizes and re.fullmatch(r"[\s\d(),x*]+", text):
        return f"write [{', '.join(sizes)}]"
    return ""
