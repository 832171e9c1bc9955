"""Generation of the step of a neuron as text, for each integrator.

The Runge-Kutta methods are the classical method of fourth order, and Fehlberg's method with step size control. Both are
explained, with their sources, in `neuro.model.neurons.integrators`. This module generates separate code for the
methods, because the threshold is tested after each substep.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from neuro.core.errors import ModelError
from neuro.core.grammar import Binary, Name, Tree
from neuro.model.equations import algebra
from neuro.model.equations.definition import CURRENT_NAME, REFRACTORY_STEPS, Definition, Receptor
from neuro.model.equations.exact import System, kernel_rows, slope_of, solution
from neuro.model.equations.writing import Constants, hoist_constants, indent, local, to_python, unpack_constants
from neuro.model.neurons.integrators import FEHLBERG

PART = "part"
"""Name of the state with the size of rkf45's substeps."""
HEAD = "step(s, c, x, i_0, lo, hi, fired)"


@dataclass(frozen=True)
class NeuronSteps:
    """A neuron whose functions are generated, with the linear system of its equations if they are linear."""

    definition: Definition
    linear: System | None
    constants: Constants

    @property
    def integrator(self) -> str:
        """Name of the chosen integrator, by default "exact"."""
        return self.definition.integrator or "exact"

    @property
    def integrated(self) -> tuple[str, ...]:
        """States with an equation, including those of kernels."""
        kernels = [name for receptor in self.definition.receptors for name in kernel_rows(receptor)]
        return (*self.definition.states, *kernels)

    @property
    def rows(self) -> dict[str, int]:
        """Row of each state in the array `s`."""
        hidden = [REFRACTORY_STEPS] if self.definition.hold is not None else []
        hidden += [PART] if self.integrator == "rkf45" else []
        return {name: k for k, name in enumerate((*self.integrated, *hidden))}

    @property
    def hold(self) -> tuple[str, ...]:
        """States that are constant during refractoriness."""
        return self.definition.hold or ()

    @property
    def resets_in_step(self) -> bool:
        """True if a spike resets the neuron within the step, when the threshold is crossed."""
        return self.integrator in ("rk4", "rkf45")

    def write(self, tree: Tree, variables: dict[str, str]) -> str:
        """Return a tree as Python. `variables` has the Python variable of each state."""
        return to_python(self.definition.full(tree), self.constants.leaf(variables))

    def fires(self, variables: dict[str, str]) -> str:
        """Return the threshold test of a neuron outside refractoriness as Python."""
        if self.definition.threshold is None:
            return "False"
        return self.write(self.definition.threshold.tree, variables)


def refuse_reserved(definition: Definition, descriptions: Mapping[str, str]) -> None:
    """Raise an error for names of hidden states of the model, and for reserved names.

    Args:
        definition: the neuron.
        descriptions: descriptions of reserved names, by name.

    Raises:
        ModelError: the first such name. The path of the error leads to the name.
    """
    slopes = {slope_of(r): f"the slope of {r.name}" for r in definition.receptors if r.kernel == "alpha"}
    reserved = {
        **descriptions,
        **slopes,
        **({PART: "the size of a substep"} if definition.integrator == "rkf45" else {}),
    }
    kernels = [receptor.name for receptor in definition.receptors]
    sections = (("equations", definition.states, reserved), ("receptors", kernels, reserved))
    for section, names, meanings in (
        *sections,
        ("parameters", definition.parameters, slopes),
        ("let", definition.let, slopes),
    ):
        for name in names:
            if name in meanings:
                message = f"{section}.{name}: '{name}' is also {meanings[name]}: expected another name"
                raise ModelError(message, path=(section, name))


def check_integrator(neuron: NeuronSteps) -> NeuronSteps:
    """Return the neuron if the integrator supports the equations.

    Raises:
        ModelError: the equations are not linear, as the exact integrator requires.
    """
    if neuron.integrator == "exact" and neuron.linear is None:
        definition, variables = neuron.definition, {*neuron.integrated, CURRENT_NAME}
        name = next(
            n for n, e in definition.states.items() if algebra.affine(definition.full(e.tree), variables) is None
        )
        message = "are not linear" if not neuron.definition.integrator else "are not linear, as 'exact' requires"
        raise ModelError(
            f"the equations {message}, see {name}: expected an integrator",
            hint="write integrator: {rkf45: {tolerance: 1e-6}}, or {rk4: {substeps: 4}}, exponential_euler, euler",
            path=("integrator",) if neuron.definition.integrator else ("equations", name),
            about=("integrator", name),
        )
    return neuron


def step_lines(neuron: NeuronSteps) -> list[str]:
    """Return the body of `step`."""
    return {
        "exact": _exact,
        "euler": _euler,
        "exponential_euler": _euler,
        "rk4": _runge_kutta,
        "rkf45": _runge_kutta,
    }[neuron.integrator](neuron)


def fire_lines(neuron: NeuronSteps) -> list[str]:
    """Return the body of `fire`."""
    if neuron.resets_in_step:
        return ["pass"]
    variables = {name: local(name) for name in neuron.integrated}
    reset = neuron.definition.reset
    names_in_reset = {word for e in reset.values() for word in algebra.names(neuron.definition.full(e.tree))}
    lines = [f"{local(name)} = s[{neuron.rows[name]}, i]" for name in neuron.integrated if name in names_in_reset]
    lines += [f"{local(name, 'next')} = {neuron.write(e.tree, variables)}" for name, e in reset.items()]
    lines += [f"s[{neuron.rows[name]}, i] = {local(name, 'next')}" for name in reset]
    if neuron.definition.hold is not None:
        lines.append(f"s[{neuron.rows[REFRACTORY_STEPS]}, i] = {neuron.constants.place_of('round(t_ref_ / h)')}")
    return lines or ["pass"]


def _exact(neuron: NeuronSteps) -> list[str]:
    """Return the step with the solution of a linear system.

    During refractoriness the states in `hold` are constant. A state that depends on a state in `hold` then has another
    solution, which is also computed.
    """
    linear = neuron.linear
    assert linear is not None
    unpack_lines: list[str] = []
    updates: dict[str, str] = {}
    for name in linear.states:
        lines, text = solution(linear, name, "SYSTEM")
        unpack_lines += lines
        if name not in neuron.hold and linear.dependencies()[name] & {*neuron.hold}:
            lines, held_text = solution(linear, name, "HELD_SYSTEM", neuron.hold)
            unpack_lines += lines
            text = f"{text} if held == 0.0 else {held_text}"
        updates[name] = text
    return unpack_lines + _loop(neuron, updates)


def _euler(neuron: NeuronSteps) -> list[str]:
    """Return the step of the Euler methods, which use the values at the beginning of the step.

    The states of kernels decay exactly.
    """
    definition = neuron.definition
    variables = {name: local(name) for name in neuron.integrated} | {CURRENT_NAME: "i_0[i]"}
    updates = {}
    for name, expression in definition.states.items():
        if neuron.integrator == "euler":
            h = neuron.constants.place_of("h")
            updates[name] = f"{local(name)} + {h} * ({neuron.write(expression.tree, variables)})"
        else:
            updates[name] = _exponential_euler(neuron, name, expression.tree, variables)
    for receptor in definition.receptors:
        updates |= _kernel_updates(neuron, receptor)
    return _loop(neuron, updates)


def _exponential_euler(neuron: NeuronSteps, name: str, tree: Tree, variables: dict[str, str]) -> str:
    """Return the exact solution of a state during a step in which all other states are constant."""
    row = algebra.affine(neuron.definition.full(tree), {name})
    if row is None:
        message = f"equations.{name}: not linear in {name}, as exponential_euler requires"
        hint = "write integrator: {rkf45: {tolerance: 1e-6}}, or {rk4: {substeps: 4}}"
        raise ModelError(message, hint=hint, path=("integrator",), about=("integrator", name))
    step, h = local("h"), neuron.constants.place_of("h")  # the definition may have a parameter h, but no `h_`
    exponent = algebra.multiply(row.get(name, algebra.ZERO), Name(step, 0))
    leaf = neuron.constants.leaf({**variables, step: h})
    rate, constant = to_python(exponent, leaf), to_python(row[""], leaf)
    return f"{local(name)} * of_exp({rate}) + ({constant}) * {h} * of_exprel({rate})"


def _kernel_updates(neuron: NeuronSteps, receptor: Receptor) -> dict[str, str]:
    if receptor.tau is None:
        return {}
    tau = neuron.constants.of_parameters(receptor.tau.tree)
    decay = neuron.constants.place_of(f"of_exp(divided(-h, {tau}))")
    value = local(receptor.name)
    if receptor.kernel == "exp":
        return {receptor.name: f"{decay} * {value}"}
    slope = local(slope_of(receptor))
    h = neuron.constants.place_of("h")
    return {receptor.name: f"{decay} * ({value} + {h} * {slope})", slope_of(receptor): f"{decay} * {slope}"}


def arrivals(neuron: NeuronSteps) -> dict[str, str]:
    """Return the input of each state in a step, by state."""
    inputs: dict[str, str] = {}
    for k, receptor in enumerate(neuron.definition.receptors):
        by_sign = k == 1 and len(neuron.definition.receptors) == 2
        text = f"-x[{k}, i]" if by_sign and receptor.magnitude else f"x[{k}, i]"
        if receptor.kernel == "alpha":
            assert receptor.tau is not None
            tau = neuron.constants.of_parameters(receptor.tau.tree)
            text = f"{neuron.constants.place_of(f'divided(math.e, {tau})')} * {text}"
        name = slope_of(receptor) if receptor.kernel == "alpha" else receptor.name
        inputs[name] = f"{inputs[name]} + {text}" if name in inputs else text
    return inputs


def _loop(neuron: NeuronSteps, updates: dict[str, str]) -> list[str]:
    """Return the loop that updates all states, adds the input, and tests the threshold.

    During refractoriness the states in `hold` do not change.
    """
    rows, has_refractoriness = neuron.rows, neuron.definition.hold is not None
    inputs = arrivals(neuron)
    body = [f"held = s[{rows[REFRACTORY_STEPS]}, i]"] if has_refractoriness else []
    body += [f"{local(name)} = s[{rows[name]}, i]" for name in neuron.integrated]
    for name, text in updates.items():
        update = f"{text} + {inputs[name]}" if name in inputs else text
        if name in neuron.hold:
            update = f"{update} if held == 0.0 else {local(name)}"
        elif " if held" in text and name in inputs:
            update = f"({text}) + {inputs[name]}"
        body.append(f"{local(name, 'next')} = {update}")
    body += [f"s[{rows[name]}, i] = {local(name, 'next')}" for name in updates]
    fires = neuron.fires({name: local(name, "next") for name in neuron.integrated})
    if has_refractoriness:
        body.append(f"s[{rows[REFRACTORY_STEPS]}, i] = 0.0 if held == 0.0 else held - 1.0")
        fires = f"({fires}) & (held == 0.0)" if neuron.definition.threshold else fires
    body.append(f"fired[i] = {fires}")
    names, body = hoist_constants(body)
    return [*unpack_constants(names), "for i in range(lo, hi):", *indent(body)]


def _runge_kutta(neuron: NeuronSteps) -> list[str]:
    """Return the step of the Runge-Kutta methods, with substeps.

    A spike resets the neuron at the end of its substep.
    """
    rows = neuron.rows
    has_refractoriness = neuron.definition.hold is not None
    arguments = ", ".join(_rate_constants(neuron) + (["held"] if has_refractoriness else []) + ["i_0[i]"])

    def call(values: dict[str, str]) -> str:
        return f"rates({arguments}, {', '.join(values.values())})"

    spike = list(_spike_lines(neuron))
    maker = rk4_lines if neuron.integrator == "rk4" else rkf45_lines
    body = [f"held = s[{rows[REFRACTORY_STEPS]}, i]"] if has_refractoriness else []
    body += [f"{local(name)} = s[{rows[name]}, i]" for name in neuron.integrated]
    body.append("fired[i] = False")
    part = f"s[{rows[PART]}, i]" if PART in rows else ""
    body += maker(neuron.integrated, call, spike, neuron.constants, neuron.definition.settings, part)
    any_delta = False
    for name, text in arrivals(neuron).items():
        is_delta = name in neuron.definition.states
        any_delta |= is_delta
        condition = " if held == 0.0 else 0.0" if name in neuron.hold else ""
        body.append(f"{local(name)} += {text}{condition}")
    body += spike if any_delta else []
    body += [f"s[{rows[name]}, i] = {local(name)}" for name in neuron.integrated]
    body += [f"s[{rows[REFRACTORY_STEPS]}, i] = 0.0 if held == 0.0 else held - 1.0"] if has_refractoriness else []
    names, body = hoist_constants(body)
    names = list(dict.fromkeys((*_rate_constants(neuron), *names)))
    return [*unpack_constants(names), "for i in range(lo, hi):", *indent(body)]


def _spike_lines(neuron: NeuronSteps) -> Iterator[str]:
    """Yield the lines that test the threshold and reset the neuron in a step.

    The refractory period includes this step.
    """
    definition = neuron.definition
    if definition.threshold is None:
        return
    variables = {name: local(name) for name in neuron.integrated}
    yield f"if {'held == 0.0 and ' if definition.hold is not None else ''}{neuron.fires(variables)}:"
    yield "    fired[i] = True"
    for name, expression in definition.reset.items():
        yield f"    {local(name, 'next')} = {neuron.write(expression.tree, variables)}"
    for name in definition.reset:
        yield f"    {local(name)} = {local(name, 'next')}"
    if definition.hold is not None:
        steps = neuron.constants.place_of("round(t_ref_ / h)")
        yield f"    held = {steps} + 1.0 if {steps} > 0.0 else 0.0"


def rates_function(neuron: NeuronSteps) -> tuple[str, list[str]]:
    """Return the arguments and the body of `rates`, which returns the derivatives of the states.

    A state above its threshold counts as at the threshold, because a step that crosses the threshold ends in a reset.
    """
    definition = neuron.definition
    variables = {name: local(name) for name in neuron.integrated} | {CURRENT_NAME: "current"}
    lines = []
    if (limited := _limited_state(neuron)) is not None:
        name, limit = limited
        lines.append(f"{local(name)} = min({local(name)}, {neuron.write(limit, {})})")
    for name, expression in definition.let.items():
        if not neuron.constants.is_of_parameters(expression.tree):
            leaf = neuron.constants.leaf(variables)
            lines.append(f"{local(name)} = {to_python(expression.tree, leaf)}")
            variables[name] = local(name)
    texts = [to_python(e.tree, neuron.constants.leaf(variables)) for e in definition.states.values()]
    texts = [
        f"0.0 if held != 0.0 else {t}" if n in neuron.hold else t for n, t in zip(definition.states, texts, strict=True)
    ]
    for receptor in definition.receptors:
        for row in kernel_rows(receptor).values():
            terms = [neuron.write(algebra.multiply(factor, Name(word, 0)), variables) for word, factor in row.items()]
            texts.append(" + ".join(terms))
    lines.append(f"return ({', '.join(texts)},)")
    names, lines = hoist_constants(lines)
    arguments = [*names, *(["held"] if definition.hold is not None else []), "current"]
    return ", ".join([*arguments, *(local(name) for name in neuron.integrated)]), lines


def _rate_constants(neuron: NeuronSteps) -> list[str]:
    arguments, _ = rates_function(neuron)
    return [word for word in arguments.split(", ") if word.startswith("c") and word[1:].isdecimal()]


def _limited_state(neuron: NeuronSteps) -> tuple[str, Tree] | None:
    """Return the state in the threshold test and the threshold, if the threshold depends on parameters only."""
    if neuron.definition.threshold is None:
        return None
    tree = neuron.definition.threshold.tree
    if not isinstance(tree, Binary) or tree.sign not in (">", ">=") or not isinstance(tree.left, Name):
        return None
    name = tree.left.name
    fits = name in neuron.definition.states and neuron.constants.is_of_parameters(tree.right)
    return (name, tree.right) if fits else None


Call = Callable[[dict[str, str]], str]
"""Function that returns the text of a call of `rates`. Its argument has the text of the value of each state."""

SMALLEST = 1e-12
"""Smallest substep, as a share of the step. It is accepted with any error."""


def rk4_lines(
    states: tuple[str, ...],
    call: Call,
    spike: list[str],
    constants: Constants,
    settings: Mapping[str, float],
    part: str,
) -> list[str]:
    """Return the lines of a step in equal substeps, with a threshold test after each substep."""
    count = int(settings["substeps"])
    h = constants.place_of("h" if count == 1 else f"h / {count}")
    lines = _stage(1, states, call({name: local(name) for name in states}))
    for stage, share in ((2, 0.5), (3, 0.5), (4, 1.0)):
        at = f"{share} * {h}" if share != 1.0 else h
        lines += _stage(stage, states, call({n: f"{local(n)} + {at} * {local(n, f'k{stage - 1}')}" for n in states}))
    for name in states:
        k1, k2, k3, k4 = (local(name, f"k{stage}") for stage in range(1, 5))
        lines.append(f"{local(name)} += {h} * ({k1} + 2.0 * {k2} + 2.0 * {k3} + {k4}) / 6.0")
    lines += spike
    return lines if count == 1 else [f"for _ in range({count}):", *indent(lines)]


def rkf45_lines(
    states: tuple[str, ...],
    call: Call,
    spike: list[str],
    constants: Constants,
    settings: Mapping[str, float],
    part: str,
) -> list[str]:
    """Return the lines of a step in substeps with errors below the tolerance and a threshold test after each substep.

    The state `part` has the size of the next substep.
    """
    h = constants.place_of("h")
    lines = [
        f"size = {part} if {part} > 0.0 else {h}",
        "t = 0.0",
        f"while t < {h}:",
        *indent(_stage(1, states, call({name: local(name) for name in states}))),
        "    trying = True",
        "    while trying:",
        *indent(_try(states, call, h, settings), 2),
        f"    t = {h} if last else t + now",
        *indent([f"{local(name)} = {local(name, 'new')}" for name in states]),
        *indent(spike),
        f"{part} = size",
    ]
    return lines


def _try(states: tuple[str, ...], call: Call, h: str, settings: Mapping[str, float]) -> list[str]:
    """Return the lines of one attempt at a substep. The lines set `trying` to whether the error is too large."""
    tolerance, by_slope = settings["tolerance"], settings["slope_tolerance"]
    lines = [f"last = size > {h} - t", f"now = {h} - t if last else size"]
    for stage in range(2, 7):
        at = {n: f"{local(n)} + now * ({_sum(FEHLBERG.stages[stage - 1], n)})" for n in states}
        lines += _stage(stage, states, call(at))
    lines += [f"{local(n, 'new')} = {local(n)} + now * ({_sum(FEHLBERG.result, n)})" for n in states]
    if by_slope:
        lines += _stage(7, states, call({n: local(n, "new") for n in states}))
    slope_tolerances = {n: f" + {by_slope!r} * abs(now * {local(n, 'k7')})" if by_slope else "" for n in states}
    errors = [f"abs(now * ({_sum(FEHLBERG.error, n)})) / ({tolerance!r}{slope_tolerances[n]})" for n in states]
    worst = errors[0]
    for error in errors[1:]:
        worst = f"max({worst}, {error})"
    return [
        *lines,
        f"worst = {worst}",
        "size = resized(now, worst)",
        f"trying = size < now and size > {SMALLEST!r} * {h}",
        "if size < now and not trying:",
        "    size = now",
    ]


def _stage(stage: int, states: tuple[str, ...], call: str) -> list[str]:
    names = "".join(f"{local(name, f'k{stage}')}, " for name in states)
    return [f"{names}= {call}"]


def _sum(factors: tuple[float, ...], name: str) -> str:
    terms = [f"{factor!r} * {local(name, f'k{k}')}" for k, factor in enumerate(factors, 1) if factor]
    return " + ".join(terms)
