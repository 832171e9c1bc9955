"""Detectors of motion: closed forms of a row, made edges with jitter and losses, and edges that a camera model sees."""

import numpy as np
import pytest

import neuro
from neuro.events import DVS, frames_of
from neuro_models import motion

ROW, TAU = 8, 5.0


def peak_of_a_row(edge: float, detector: float, towards: int, h: float) -> float:
    """Largest V_m of a leaky neuron behind a row of pixels; the edge runs along the row, or with -1 against it."""
    pixels = np.arange(ROW)
    crossed = 1.0 + (pixels if towards > 0 else ROW - 1 - pixels) / edge
    waits = motion.delays(ROW, [detector], [0.0])[:ROW, 0] + h
    net = neuro.Network("row", resolution=h)
    net.population("row", ROW, neuro.spike_generator(spike_times=[[h * round(t / h)] for t in crossed]))
    net.population("detector", 1, neuro.iaf_psc_delta(tau_m=TAU, E_L=0.0, V_reset=0.0, V_th=100.0))
    net.connect("row", "detector", neuro.all_to_all(), weight=1.0, delay=h * np.rint(waits / h)[:, None])
    net.probe("v", "detector", "V_m", every=h)
    sim = neuro.compile(net, "reference")
    sim.run(2.0 + crossed.max() + waits.max())
    return float(sim.trace("v")[1].max())


@pytest.mark.parametrize(("edge", "detector"), [(0.5, 0.5), (0.5, 0.25), (0.25, 0.5), (0.5, 1.0)])
@pytest.mark.parametrize("towards", [1, -1])
def test_the_peak_behind_a_row_is_a_geometric_sum(edge, detector, towards):
    """Arrivals are |1/v - 1/v0| ms apart, against the row 1/v + 1/v0; all of these lie on the grid."""
    apart = abs(1.0 / edge - towards / detector)
    q = np.exp(-apart / TAU)
    expected = ROW if apart == 0.0 else (1.0 - q**ROW) / (1.0 - q)
    assert peak_of_a_row(edge, detector, towards, h=0.5) == pytest.approx(expected, abs=1e-9)


def test_delays_let_the_own_edge_arrive_at_once():
    waits = motion.delays().reshape(8, 8, 8, 8)
    y, x = np.indices((8, 8))
    for s, speed in enumerate(motion.SPEEDS):
        for d, angle in enumerate(np.deg2rad(motion.DIRECTIONS)):
            arrival = (x * np.cos(angle) + y * np.sin(angle)) / speed + waits[:, :, s, d]
            np.testing.assert_allclose(arrival, arrival[0, 0], atol=1e-12)
    assert waits.min() == 0.0
    assert waits[:, :, 0, 0].max() == pytest.approx(70.0)


def test_the_network_goes_through_a_file(tmp_path):
    net = motion.network()
    assert net.populations["detectors"].shape == (1, 8, 8)
    net.save(tmp_path / "motion.yaml")
    assert neuro.load(tmp_path / "motion.yaml") == net


@pytest.mark.parametrize(
    ("longest", "directions", "both"),
    [(np.inf, 1.0, 0.99), (62.0, 1.0, 0.99), (16.0, 0.93, 0.85)],
)
def test_made_edges_are_told(longest, directions, both):
    """Without a limit of delay, with Loihi's 62 steps, and with SpiNNaker's 16."""
    n = 192
    sim = neuro.compile(motion.network(n, longest=longest))
    speed, direction, times, ids = motion.drawn_edges(20, n)
    found = motion.shares(motion.peaks(sim, times, ids), speed, direction)
    assert found[0] >= directions
    assert found[1] >= both


def test_an_edge_against_a_detector_excites_it_least():
    sim = neuro.compile(motion.network(64))
    speed, direction, times, ids = motion.drawn_edges(21, 64)
    peaks = motion.peaks(sim, times, ids)
    patch = np.arange(64)
    own = peaks[patch, speed, direction]
    assert np.all(peaks[patch, speed, (direction + 4) % 8] < 0.5 * own)


def test_it_is_shown_anew_each_time():
    sim = neuro.compile(motion.network())
    _, _, times, ids = motion.drawn_edges(22, 1)
    first = motion.peaks(sim, times, ids)
    assert np.array_equal(motion.peaks(sim, times, ids), first)
    assert np.all(motion.peaks(sim, [], []) == 0.0)


def test_the_reference_has_the_same_peaks():
    _, _, times, ids = motion.drawn_edges(23, 2)
    on_event, on_reference = (neuro.compile(motion.network(2), backend) for backend in ("event", "reference"))
    assert np.array_equal(motion.peaks(on_event, times, ids), motion.peaks(on_reference, times, ids))


def test_numbers_that_cannot_be(messages):
    messages.calls(globals())


def test_events_find_their_patch():
    times, ids = motion.to_patches([0, 999, 1000, 5, 5], [0, 9, 15, 16, -1], [0, 1, 7, 3, 3], columns=2)
    assert times.tolist() == [1.0, 1.0, 2.0]
    assert ids.tolist() == [0, 64 + 8 + 1, 64 + 56 + 7]
    times, ids = motion.to_patches([700], [2], [5], rows=2, side=4, resolution=0.5)
    assert (times.tolist(), ids.tolist()) == ([1.0], [16 + 4 + 2])


def test_edges_that_a_camera_sees_are_told():
    """Every third of the 64 motions, before pixels with noise that fire five to seven times at an edge."""
    speed, direction = np.indices((8, 8)).reshape(2, -1)[:, ::3]
    n = len(speed)
    told = []
    for patch, (v, angle) in enumerate(
        zip(motion.SPEEDS[speed], np.deg2rad(motion.DIRECTIONS[direction]), strict=True)
    ):
        events = seen_by_a_camera(v, angle, seed=patch)
        told.append(motion.to_patches(events.t, events.x + 8 * patch, events.y, columns=n))
    times, ids = (np.concatenate(part) for part in zip(*told, strict=True))
    sim = neuro.compile(motion.network(n))
    assert motion.shares(motion.peaks(sim, times, ids), speed, direction) == (1.0, 1.0)


def seen_by_a_camera(speed: float, angle: float, seed: int):
    """Events of 8 x 8 pixels that a bright edge crosses."""
    y, x = np.indices((8, 8))
    along = x * np.cos(angle) + y * np.sin(angle)
    along -= along.min()

    def scene(t_us):
        return 0.2 + 0.6 * (1e-3 * speed * t_us - along).clip(0.0, 1.0)

    end = int(1e3 * (along.max() + 2.0) / speed)
    return DVS((8, 8), seed=seed).record(frames_of(scene, 0, end, step_us=1000))


def test_the_direction_of_card_pips_is_read(shared):
    """POKER-DVS: the residual motion of pips in windows that followed them.

    The truth is the slope of a straight line through the events' places over time, if it is as fast as a detector.
    Every other recording is tested; size of patches, polarity and this readout were chosen with those between.
    """
    data = np.load(shared / "data" / "poker_dvs" / "poker_dvs_shared.npz")
    toward = np.exp(1j * np.deg2rad(motion.DIRECTIONS))
    sim, seen, errors = neuro.compile(motion.network(4, side=16)), 0, []
    for begin, end in zip(data["offsets"], data["offsets"][1:], strict=False):
        t, x, y, p = (data[name][begin:end] for name in "txyp")
        truth = np.polyfit(t / 1000.0, x, 1)[0] + 1j * np.polyfit(t / 1000.0, y, 1)[0]
        half = (motion.SPEEDS[1] / motion.SPEEDS[0]) ** 0.5
        if motion.SPEEDS[0] / half < abs(truth) < motion.SPEEDS[-1] * half:
            seen += 1
            if seen % 2:
                continue
            on = (p == 1) & (x > 0) & (y > 0)
            peaks = motion.peaks(sim, *motion.to_patches(t[on], x[on] - 1, y[on] - 1, rows=2, columns=2, side=16))
            errors.append(abs(np.rad2deg(np.angle(peaks.sum(axis=(0, 1)) @ toward / truth))))
    tested = np.array(errors)
    assert len(tested) == 37
    assert np.median(tested) < 15.0
    assert np.mean(tested < 45.0) > 0.85
