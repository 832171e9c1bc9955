"""What lies in the log is delivered, if anything does: most steps of a small network emit nothing."""

# mypy: ignore-errors
from neuro.kernels.jit import merged
from neuro_event.stages import deliver_log
from neuro_event.tables import SOURCE
from neuro_event.views import net_of


@merged
def spikes(net, source, slot):
    """How many neurons of a population fired in the step whose ends are kept at a slot."""
    n = 0
    for t in range(net.edges.shape[1] - 1):
        n += net.log_ends[t, slot, source + 1] - net.log_ends[t, slot, source]
    return n


@merged
def log_delivery(view, q, j, k, begin, stop, ring):
    """Deliver what projection q's source emitted in step j, if it did, as `deliver_log`."""
    net = net_of(view)
    if spikes(net, net.projections[q, SOURCE], j & (net.log_ends.shape[1] - 1)) > 0:
        deliver_log(view, q, j, k, begin, stop, ring)
