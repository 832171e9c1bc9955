"""The neurons of Loihi 2 as C, in the arithmetic of `templates/loihi2.h`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from neuro.exchange.c_code.arrays import Memory
from neuro.exchange.c_code.cells import Cells, Registers, Stepped, arriving, shared


def loihi2_lif(cells: Cells, memory: Memory) -> Stepped:
    """Neurons with a threshold, see `neuro.model.neurons.loihi2_lif`."""
    own = Registers(cells, memory)
    body, begins = _integrated(cells, own)
    v, threshold = own.state("v"), own.text("threshold", cells.fixed.registers["vth"] * 64)
    own.falls(v, "0")
    return own.stepped(begins, threshold, [*body, f"if ({v} > {threshold}) {{", "    fire(i);", "}"])


def loihi2_ternary_lif(cells: Cells, memory: Memory) -> Stepped:
    """Neurons with two thresholds, which send signs."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    body, begins = _integrated(cells, own)
    v = own.state("v")
    high, low = (own.text(word, r[word] * 64) for word in ("vth_hi", "vth_lo"))
    body += [f"int32_t sign = ({v} > {high}) - ({v} < {low});", f"if (sign != 0) {v} = 0;"]
    return own.sending(begins, body, "(uint32_t)sign")


def _integrated(cells: Cells, own: Registers) -> tuple[list[str], list[str]]:
    """The current and the voltage of neuron i; and what is done before the loop over all."""
    r = cells.fixed.registers
    v, keep = own.state("v"), 4095 - r["du"]
    u = own.state("u") if keep.any() else ""
    begins, interval = [arriving(cells)], shared(r, "reset_interval")
    if interval:
        arrays = [each.removesuffix("[i]") for each in (v, u) if each]
        test = f"if (now % {interval}u == {shared(r, 'reset_offset') % interval}u) {{"
        begins += [test, *(f"    memset({each}, 0, sizeof {each});" for each in arrays), "}"]
    bias, leak = own.text("bias", r["bias_mant"] << r["bias_exp"]), own.text("keep_v", 4096 - r["dv"])
    body = [f"int32_t u = next_u({u or '0'}, {own.text('keep_u', keep)}, in[i]);", *([f"{u} = u;"] if u else [])]
    return [*body, "in[i] = 0;", f"{v} = next_v({v}, {leak}, u, {bias});"], begins


def sigma_delta(cells: Cells, memory: Memory) -> Stepped:
    """Sums of messages, their activations, and the changes of these."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    sigma = own.state("sigma")
    bias = own.text("bias", r["bias"])
    body = [f"int32_t y = plus({sigma} = plus({sigma}, wrap32(in[i])), {bias});"]
    return _encoding(cells, own, [*body, *(["if (y < 0) y = 0;"] if shared(r, "relu") else [])])


def delta_encoder(cells: Cells, memory: Memory) -> Stepped:
    """Changes of what arrives."""
    exponent = sum(shared(cells.fixed.registers, word) for word in ("spike_exp", "state_exp"))
    return _encoding(cells, Registers(cells, memory), [f"int32_t y = scaled(in[i], {exponent}u);"])


def _encoding(cells: Cells, own: Registers, body: Sequence[str]) -> Stepped:
    r = cells.fixed.registers
    states = ("act", "residue", *(["error"] if shared(r, "cum_error") else []))
    places = [f"&{own.state(word)}" for word in states] + ["NULL"]
    words = f"{', '.join(places[:3])}, y, {own.text('vth', r['vth'])}, {shared(r, 'state_exp')}u"
    return own.sending([arriving(cells)], [*body, "in[i] = 0;"], f"encoded({words})")


def sigma_decoder(cells: Cells, memory: Memory) -> Stepped:
    """Sums of messages, sent as they are."""
    own = Registers(cells, memory)
    sigma = own.state("sigma")
    body = [f"{sigma} = plus({sigma}, wrap32(in[i]));", "in[i] = 0;"]
    return own.sending([arriving(cells)], body, f"(uint32_t){sigma}")


def graded_vector(cells: Cells, memory: Memory) -> Stepped:
    """What arrives, where it is large enough."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    body = ["int32_t input = wrap32(in[i]);", "in[i] = 0;"]
    words = f"input, {own.text('vth', r['vth'])}, {int(not shared(r, 'relu'))}"
    return own.sending([arriving(cells)], body, f"passed({words})")


def graded_product(cells: Cells, memory: Memory) -> Stepped:
    """The product of what arrives at both receptors, where it is large enough."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    slots = ("in[i]", "below[i]")[: cells.receptors]
    body = [
        f"int32_t product = wrap32((int64_t)({' * '.join([*slots, '0u'][:2])}));",
        *(f"{slot} = 0;" for slot in slots),
    ]
    words = f"(int32_t)floor_shift(product, {shared(r, 'exp')}u), {own.text('vth', r['vth'])}, 1"
    return own.sending([arriving(cells)], body, f"passed({words})")


def resonator(fires: Callable[[str, str, str], tuple[str, str]]) -> Callable[[Cells, Memory], Stepped]:
    """Neurons whose state turns.

    Args:
        fires: gives the test whether one fires, and what follows, from the texts of its real and its imaginary part,
            and of its threshold; `before` is the old imaginary part.
    """

    def stepped(cells: Cells, memory: Memory) -> Stepped:
        r, own = cells.fixed.registers, Registers(cells, memory)
        real, imag = own.state("real"), own.state("imag")
        exponent = shared(r, "state_exp")
        test, reset = fires(real, imag, own.text("threshold", r["vth"]))
        slots = ("in[i]", "below[i]")[: cells.receptors]
        inputs = [f"scaled({slot}, {exponent}u)" for slot in slots] + ["0"]
        factors = ", ".join(own.text(word, r[word]) for word in ("cos_decay", "sin_decay"))
        body = [f"int32_t before = {imag};", f"turn(&{real}, &{imag}, {factors}, {inputs[0]}, {inputs[1]});"]
        body += [*(f"{slot} = 0;" for slot in slots), f"uint32_t fires = {test};", "(void)before;"]
        return own.sending([arriving(cells)], [*body, *([f"if (fires) {reset}"] if reset else [])], "fires")

    return stepped


loihi2_rf = resonator(lambda real, imag, vth: (f"{real} >= {vth} && {imag} >= 0 && before < 0", ""))
loihi2_rf_iz = resonator(lambda real, imag, vth: (f"{imag} >= {vth}", f"{real} = 0, {imag} = {vth} - 1;"))
