"""The step of a neuron as text, by each of the integrators.

Runge-Kutta's are the classical one of fourth order, and Fehlberg's with the size of its steps controlled; method and
source are those of `neuro.model.neurons.integrators`. They are written once more here, since a threshold is looked at
after each part of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from neuro.core.errors import ModelError
from neuro.core.grammar import Binary, Name, Tree
from neuro.model.equations import algebra
from neuro.model.equations.definition import CURRENT_NAME, HELD, Definition, Receptor
from neuro.model.equations.exact import System, kernel_rows, slope_of, solution
from neuro.model.equations.writing import Constants, hoisted, indented, local, unpacked, written
from neuro.model.neurons.integrators import FEHLBERG

PART = "part"
"""The state that keeps the size of rkf45's steps."""
HEAD = "step(s, c, x, i_0, lo, hi, fired)"


@dataclass(frozen=True)
class NeuronSteps:
    """What is needed to write a neuron's functions: its definition, its linear system, its constants and its rows."""

    definition: Definition
    linear: System | None
    constants: Constants

    @property
    def integrator(self) -> str:
        """The one that was chosen; the exact one for a linear system."""
        return self.definition.integrator or "exact"

    @property
    def integrated(self) -> tuple[str, ...]:
        """The states that follow equations, those of kernels among them."""
        kernels = [name for receptor in self.definition.receptors for name in kernel_rows(receptor)]
        return (*self.definition.states, *kernels)

    @property
    def rows(self) -> dict[str, int]:
        """The row of each state."""
        hidden = [HELD] if self.definition.hold is not None else []
        hidden += [PART] if self.integrator == "rkf45" else []
        return {name: k for k, name in enumerate((*self.integrated, *hidden))}

    @property
    def hold(self) -> tuple[str, ...]:
        """The states that stay while the neuron is refractory."""
        return self.definition.hold or ()

    @property
    def resets_in_step(self) -> bool:
        """Whether a spike acts within the step, where the threshold is crossed."""
        return self.integrator in ("rk4", "rkf45")

    def write(self, tree: Tree, variables: dict[str, str]) -> str:
        """A tree as Python, its states as the given variables."""
        return written(self.definition.full(tree), self.constants.leaf(variables))

    def fires(self, variables: dict[str, str]) -> str:
        """The threshold as Python, for a neuron that is not refractory."""
        if self.definition.threshold is None:
            return "False"
        return self.write(self.definition.threshold.tree, variables)


def refuse_added(d: Definition, others: Mapping[str, str]) -> None:
    """Refuse names of states that a model has beside those of its author, and of what is read like a state.

    Args:
        d: the neuron.
        others: what is read like a state, by name.

    Raises:
        ModelError: the first such name; its path leads there.
    """
    slopes = {slope_of(r): f"the slope of {r.name}" for r in d.receptors if r.kernel == "alpha"}
    added = {**others, **slopes, **({PART: "the size of a part of a step"} if d.integrator == "rkf45" else {})}
    kernels = [receptor.name for receptor in d.receptors]
    sections = (("equations", d.states, added), ("receptors", kernels, added))
    for section, names, meanings in (*sections, ("parameters", d.parameters, slopes), ("let", d.let, slopes)):
        for name in names:
            if name in meanings:
                message = f"{section}.{name}: '{name}' is {meanings[name]}, too: expected another name"
                raise ModelError(message, path=(section, name))


def checked(neuron: NeuronSteps) -> NeuronSteps:
    """The neuron, if its integrator can do its equations.

    Raises:
        ModelError: it cannot.
    """
    if neuron.integrator == "exact" and neuron.linear is None:
        d, variables = neuron.definition, {*neuron.integrated, CURRENT_NAME}
        name = next(n for n, e in d.states.items() if algebra.affine(d.full(e.tree), variables) is None)
        message = "are not linear" if not neuron.definition.integrator else "are not linear, as 'exact' needs"
        raise ModelError(
            f"the equations {message}, see {name}: expected an integrator",
            hint="write integrator: {rkf45: {tolerance: 1e-6}}, or {rk4: {substeps: 4}}, exponential_euler, euler",
            path=("integrator",) if neuron.definition.integrator else ("equations", name),
            about=("integrator", name),
        )
    return neuron


def step_lines(neuron: NeuronSteps) -> list[str]:
    """The body of `step`."""
    return {
        "exact": _exact,
        "euler": _euler,
        "exponential_euler": _euler,
        "rk4": _runge_kutta,
        "rkf45": _runge_kutta,
    }[neuron.integrator](neuron)


def fire_lines(neuron: NeuronSteps) -> list[str]:
    """The body of `fire`."""
    if neuron.resets_in_step:
        return ["pass"]
    variables = {name: local(name) for name in neuron.integrated}
    reset = neuron.definition.reset
    used = {word for e in reset.values() for word in algebra.names(neuron.definition.full(e.tree))}
    lines = [f"{local(name)} = s[{neuron.rows[name]}, i]" for name in neuron.integrated if name in used]
    lines += [f"{local(name, 'next')} = {neuron.write(e.tree, variables)}" for name, e in reset.items()]
    lines += [f"s[{neuron.rows[name]}, i] = {local(name, 'next')}" for name in reset]
    if neuron.definition.hold is not None:
        lines.append(f"s[{neuron.rows[HELD]}, i] = {neuron.constants.place_of('round(t_ref_ / h)')}")
    return lines or ["pass"]


def _exact(neuron: NeuronSteps) -> list[str]:
    """The solution of a linear system; where states depend on held ones, a second one for held neurons."""
    linear = neuron.linear
    assert linear is not None
    before: list[str] = []
    updates: dict[str, str] = {}
    for name in linear.states:
        lines, text = solution(linear, name, "SYSTEM")
        before += lines
        if name not in neuron.hold and linear.reached()[name] & {*neuron.hold}:
            lines, other = solution(linear, name, "HELD_SYSTEM", neuron.hold)
            before += lines
            text = f"{text} if held == 0.0 else {other}"
        updates[name] = text
    return before + _loop(neuron, updates)


def _euler(neuron: NeuronSteps) -> list[str]:
    """All from the values at the beginning of the step; kernels decay exactly."""
    d = neuron.definition
    variables = {name: local(name) for name in neuron.integrated} | {CURRENT_NAME: "i_0[i]"}
    updates = {}
    for name, expression in d.states.items():
        if neuron.integrator == "euler":
            h = neuron.constants.place_of("h")
            updates[name] = f"{local(name)} + {h} * ({neuron.write(expression.tree, variables)})"
        else:
            updates[name] = _relaxing(neuron, name, expression.tree, variables)
    for receptor in d.receptors:
        updates |= _kernel_updates(neuron, receptor)
    return _loop(neuron, updates)


def _relaxing(neuron: NeuronSteps, name: str, tree: Tree, variables: dict[str, str]) -> str:
    """A state that goes exactly towards where the others, held at their values, would keep it."""
    row = algebra.affine(neuron.definition.full(tree), {name})
    if row is None:
        message = f"equations.{name}: not linear in {name}, as exponential_euler needs"
        hint = "write integrator: {rkf45: {tolerance: 1e-6}}, or {rk4: {substeps: 4}}"
        raise ModelError(message, hint=hint, path=("integrator",), about=("integrator", name))
    step, h = local("h"), neuron.constants.place_of("h")  # no name of an author's, who may have an h
    exponent = algebra.multiplied(row.get(name, algebra.ZERO), Name(step, 0))
    leaf = neuron.constants.leaf({**variables, step: h})
    rate, rest = written(exponent, leaf), written(row[""], leaf)
    return f"{local(name)} * of_exp({rate}) + ({rest}) * {h} * of_exprel({rate})"


def _kernel_updates(neuron: NeuronSteps, receptor: Receptor) -> dict[str, str]:
    if receptor.tau is None:
        return {}
    tau = neuron.constants.of_parameters(receptor.tau.tree)
    fall = neuron.constants.place_of(f"of_exp(divided(-h, {tau}))")
    value = local(receptor.name)
    if receptor.kernel == "exp":
        return {receptor.name: f"{fall} * {value}"}
    slope = local(slope_of(receptor))
    h = neuron.constants.place_of("h")
    return {receptor.name: f"{fall} * ({value} + {h} * {slope})", slope_of(receptor): f"{fall} * {slope}"}


def arrivals(neuron: NeuronSteps) -> dict[str, str]:
    """What arrives at each state in a step."""
    found: dict[str, str] = {}
    for k, receptor in enumerate(neuron.definition.receptors):
        by_sign = k == 1 and len(neuron.definition.receptors) == 2
        text = f"-x[{k}, i]" if by_sign and receptor.magnitude else f"x[{k}, i]"
        if receptor.kernel == "alpha":
            assert receptor.tau is not None
            tau = neuron.constants.of_parameters(receptor.tau.tree)
            text = f"{neuron.constants.place_of(f'divided(math.e, {tau})')} * {text}"
        name = slope_of(receptor) if receptor.kernel == "alpha" else receptor.name
        found[name] = f"{found[name]} + {text}" if name in found else text
    return found


def _loop(neuron: NeuronSteps, updates: dict[str, str]) -> list[str]:
    """All states at once, then the input, then the threshold; what is held stays."""
    rows, held = neuron.rows, neuron.definition.hold is not None
    arriving = arrivals(neuron)
    body = [f"held = s[{rows[HELD]}, i]"] if held else []
    body += [f"{local(name)} = s[{rows[name]}, i]" for name in neuron.integrated]
    for name, text in updates.items():
        whole = f"{text} + {arriving[name]}" if name in arriving else text
        if name in neuron.hold:
            whole = f"{whole} if held == 0.0 else {local(name)}"
        elif " if held" in text and name in arriving:
            whole = f"({text}) + {arriving[name]}"
        body.append(f"{local(name, 'next')} = {whole}")
    body += [f"s[{rows[name]}, i] = {local(name, 'next')}" for name in updates]
    fires = neuron.fires({name: local(name, "next") for name in neuron.integrated})
    if held:
        body.append(f"s[{rows[HELD]}, i] = 0.0 if held == 0.0 else held - 1.0")
        fires = f"({fires}) & (held == 0.0)" if neuron.definition.threshold else fires
    body.append(f"fired[i] = {fires}")
    names, body = hoisted(body)
    return [*unpacked(names), "for i in range(lo, hi):", *indented(body)]


def _runge_kutta(neuron: NeuronSteps) -> list[str]:
    """Several parts a step; a spike resets within the step, where the threshold is crossed."""
    rows = neuron.rows
    held = neuron.definition.hold is not None
    arguments = ", ".join(_rate_constants(neuron) + (["held"] if held else []) + ["i_0[i]"])

    def call(values: dict[str, str]) -> str:
        return f"rates({arguments}, {', '.join(values.values())})"

    spike = list(_spike_lines(neuron))
    maker = rk4_lines if neuron.integrator == "rk4" else rkf45_lines
    body = [f"held = s[{rows[HELD]}, i]"] if held else []
    body += [f"{local(name)} = s[{rows[name]}, i]" for name in neuron.integrated]
    body.append("fired[i] = False")
    part = f"s[{rows[PART]}, i]" if PART in rows else ""
    body += maker(neuron.integrated, call, spike, neuron.constants, neuron.definition.settings, part)
    delta = False
    for name, text in arrivals(neuron).items():
        late = name in neuron.definition.states
        delta |= late
        condition = " if held == 0.0 else 0.0" if name in neuron.hold else ""
        body.append(f"{local(name)} += {text}{condition}")
    body += spike if delta else []
    body += [f"s[{rows[name]}, i] = {local(name)}" for name in neuron.integrated]
    body += [f"s[{rows[HELD]}, i] = 0.0 if held == 0.0 else held - 1.0"] if held else []
    names, body = hoisted(body)
    names = list(dict.fromkeys((*_rate_constants(neuron), *names)))
    return [*unpacked(names), "for i in range(lo, hi):", *indented(body)]


def _spike_lines(neuron: NeuronSteps) -> Iterator[str]:
    """The threshold and what a spike does, within a step; a neuron that is held afterwards counts this step, too."""
    d = neuron.definition
    if d.threshold is None:
        return
    variables = {name: local(name) for name in neuron.integrated}
    yield f"if {'held == 0.0 and ' if d.hold is not None else ''}{neuron.fires(variables)}:"
    yield "    fired[i] = True"
    for name, expression in d.reset.items():
        yield f"    {local(name, 'next')} = {neuron.write(expression.tree, variables)}"
    for name in d.reset:
        yield f"    {local(name)} = {local(name, 'next')}"
    if d.hold is not None:
        steps = neuron.constants.place_of("round(t_ref_ / h)")
        yield f"    held = {steps} + 1.0 if {steps} > 0.0 else 0.0"


def rates_function(neuron: NeuronSteps) -> tuple[str, list[str]]:
    """Arguments and body of `rates`: how fast each state changes.

    A state at its threshold counts as at most there, as a step that crosses it ends in a reset.
    """
    d = neuron.definition
    variables = {name: local(name) for name in neuron.integrated} | {CURRENT_NAME: "current"}
    lines = []
    if (capped := _capped(neuron)) is not None:
        name, limit = capped
        lines.append(f"{local(name)} = min({local(name)}, {neuron.write(limit, {})})")
    for name, expression in d.let.items():
        if not neuron.constants.is_of_parameters(expression.tree):
            leaf = neuron.constants.leaf(variables)
            lines.append(f"{local(name)} = {written(expression.tree, leaf)}")
            variables[name] = local(name)
    texts = [written(e.tree, neuron.constants.leaf(variables)) for e in d.states.values()]
    texts = [f"0.0 if held != 0.0 else {t}" if n in neuron.hold else t for n, t in zip(d.states, texts, strict=True)]
    for receptor in d.receptors:
        for row in kernel_rows(receptor).values():
            terms = [neuron.write(algebra.multiplied(factor, Name(word, 0)), variables) for word, factor in row.items()]
            texts.append(" + ".join(terms))
    lines.append(f"return ({', '.join(texts)},)")
    names, lines = hoisted(lines)
    arguments = [*names, *(["held"] if d.hold is not None else []), "current"]
    return ", ".join([*arguments, *(local(name) for name in neuron.integrated)]), lines


def _rate_constants(neuron: NeuronSteps) -> list[str]:
    arguments, _ = rates_function(neuron)
    return [word for word in arguments.split(", ") if word.startswith("c") and word[1:].isdecimal()]


def _capped(neuron: NeuronSteps) -> tuple[str, Tree] | None:
    """The state at the threshold and the threshold, if it is one of parameters."""
    if neuron.definition.threshold is None:
        return None
    tree = neuron.definition.threshold.tree
    if not isinstance(tree, Binary) or tree.sign not in (">", ">=") or not isinstance(tree.left, Name):
        return None
    name = tree.left.name
    fits = name in neuron.definition.states and neuron.constants.is_of_parameters(tree.right)
    return (name, tree.right) if fits else None


Call = Callable[[dict[str, str]], str]
"""The text that asks for the rates at some values, by state."""

SMALLEST = 1e-12
"""The smallest part of a step that is taken, however large its error."""


def rk4_lines(
    states: tuple[str, ...],
    call: Call,
    spike: list[str],
    constants: Constants,
    settings: Mapping[str, float],
    part: str,
) -> list[str]:
    """A step in some equal parts, with the threshold after each."""
    count = int(settings["substeps"])
    h = constants.place_of("h" if count == 1 else f"h / {count}")
    lines = _stage(1, states, call({name: local(name) for name in states}))
    for stage, share in ((2, 0.5), (3, 0.5), (4, 1.0)):
        near = f"{share} * {h}" if share != 1.0 else h
        lines += _stage(stage, states, call({n: f"{local(n)} + {near} * {local(n, f'k{stage - 1}')}" for n in states}))
    for name in states:
        k1, k2, k3, k4 = (local(name, f"k{stage}") for stage in range(1, 5))
        lines.append(f"{local(name)} += {h} * ({k1} + 2.0 * {k2} + 2.0 * {k3} + {k4}) / 6.0")
    lines += spike
    return lines if count == 1 else [f"for _ in range({count}):", *indented(lines)]


def rkf45_lines(
    states: tuple[str, ...],
    call: Call,
    spike: list[str],
    constants: Constants,
    settings: Mapping[str, float],
    part: str,
) -> list[str]:
    """A step in parts of errors below the tolerance, with the threshold after each; `part` keeps their size."""
    h = constants.place_of("h")
    lines = [
        f"size = {part} if {part} > 0.0 else {h}",
        "t = 0.0",
        f"while t < {h}:",
        *indented(_stage(1, states, call({name: local(name) for name in states}))),
        "    trying = True",
        "    while trying:",
        *indented(_try(states, call, h, settings), 2),
        f"    t = {h} if last else t + now",
        *indented([f"{local(name)} = {local(name, 'new')}" for name in states]),
        *indented(spike),
        f"{part} = size",
    ]
    return lines


def _try(states: tuple[str, ...], call: Call, h: str, settings: Mapping[str, float]) -> list[str]:
    tolerance, by_slope = settings["tolerance"], settings["slope_tolerance"]
    lines = [f"last = size > {h} - t", f"now = {h} - t if last else size"]
    for stage in range(2, 7):
        near = {n: f"{local(n)} + now * ({_sum(FEHLBERG.stages[stage - 1], n)})" for n in states}
        lines += _stage(stage, states, call(near))
    lines += [f"{local(n, 'new')} = {local(n)} + now * ({_sum(FEHLBERG.result, n)})" for n in states]
    if by_slope:
        lines += _stage(7, states, call({n: local(n, "new") for n in states}))
    allowed = {n: f" + {by_slope!r} * abs(now * {local(n, 'k7')})" if by_slope else "" for n in states}
    errors = [f"abs(now * ({_sum(FEHLBERG.error, n)})) / ({tolerance!r}{allowed[n]})" for n in states]
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
