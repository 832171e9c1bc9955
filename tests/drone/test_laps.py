"""Both tasks: starts as wished, judged by geometry, and laps that only following earns."""

from itertools import pairwise
from math import atan2, cos, degrees, hypot, inf, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro import ModelError
from neuro_drone.ball import BallTask
from neuro_drone.body import Kinematic
from neuro_drone.evaluate import grid
from neuro_drone.geometry import CameraView, Pose
from neuro_drone.line import LineTask
from neuro_drone.paths import FIXED, FlightCourse, Variation
from neuro_drone.scenario import NAMES, load
from neuro_drone.tasks import border

BALLS = [name for name in NAMES if load(name).kind == "ball" and "-" not in name]
QUIET = settings(deadline=None, max_examples=40)


def begin(scenario, start=None, direction=0, seed=0, varied=FIXED):
    """A task, the drone's body at its start, and its camera."""
    camera = scenario.camera
    view = CameraView(fov=camera.fov, tilt=camera.tilt)
    kind = BallTask if scenario.kind == "ball" else LineTask
    task = kind(scenario.task, CameraView(fov=camera.fov, tilt=camera.tilt), scenario.drone.height)
    body = Kinematic(scenario.drone)
    pose = task.reset(np.random.default_rng(seed), start, direction, varied)
    body.reset(pose.x, pose.y, pose.yaw, forward=task.forward)
    view.look(body.pose)
    return task, body, view, task.judge(view, body.pose)


def fly(scenario, act, start=None, direction=0, seed=0, varied=FIXED, most=20_000):
    """Fly until the end without a camera; `act` gives two commands in [-1, 1] from what was judged."""
    task, body, view, judged = begin(scenario, start, direction, seed, varied)
    drone, seconds = scenario.drone, scenario.step / 1000.0
    for step in range(most):
        a, b = act(step, judged)
        if task.turns:
            body.step(a * drone.v_max, task.forward, b * drone.yaw_max, seconds)
        else:
            body.step(a * drone.v_max, -b * drone.v_max, 0.0, seconds)
        task.advance(seconds)
        view.look(body.pose)
        judged = task.judge(view, body.pose)
        if judged.lost or judged.done:
            return judged, step + 1
    raise AssertionError("the episode has no end")


def oracle(gain):
    def act(step, judged):
        a, b = judged.scaled
        return max(-1.0, min(1.0, gain * a)), max(-1.0, min(1.0, gain * b))

    return act


def nothing(step, judged):
    return 0.0, 0.0


def moved(scenario, place):
    """Judge a camera that is carried: `place` gives where it aims after some seconds."""
    task, _, view, judged = begin(scenario, (0.0, 0.0))
    view.look(Pose(0.0, 0.0, scenario.drone.height))
    dx, dy = view.ground(63.0, 63.0, scenario.task.radius)
    seconds = scenario.step / 1000.0
    time = 0.0
    while not (judged.lost or judged.done):
        time += seconds
        task.advance(seconds)
        x, y = place(time, task)
        pose = Pose(x - dx, y - dy, scenario.drone.height)
        view.look(pose)
        judged = task.judge(view, pose)
    return judged


@pytest.mark.parametrize("name", BALLS)
@given(st.floats(-60, 60), st.floats(-25, 60))
@QUIET
def test_a_ball_begins_where_it_is_wished(name, du, dv):
    *_, judged = begin(load(name), (du, dv))
    assert judged.error == pytest.approx((du, dv), abs=1e-9)
    assert judged.error_px == pytest.approx(hypot(du, dv))
    assert judged.target == pytest.approx((63 + du, 63 + dv))
    assert judged.reward == pytest.approx(1 - hypot(du, dv) / hypot(64.5, 64.5))


@given(st.floats(-60, 60), st.floats(-45, 45), st.sampled_from([1, -1]))
@QUIET
def test_a_line_begins_where_it_is_wished(du, lean, direction):
    *_, judged = begin(load("line"), (du, lean), direction)
    assert judged.error == pytest.approx((du, lean), abs=1e-6)
    assert judged.scaled == pytest.approx((du / 64, lean / 90))
    assert judged.reward == pytest.approx(1 - 0.5 * (abs(du) / 64.5 + abs(lean) / 90))


@given(st.integers(0, 1000))
@QUIET
def test_starts_are_drawn_around_the_aim(seed):
    *_, ball = begin(load("B60"), seed=seed)
    *_, line = begin(load("line"), seed=seed)
    assert max(map(abs, ball.error)) <= 50.0
    assert abs(line.error[0]) <= 35.0 + 1e-9
    assert abs(line.error[1]) <= 15.0 + 1e-9


@pytest.mark.parametrize("tilt", [10.0, 15.0, 20.0])
def test_a_camera_that_sees_the_horizon_has_starts_below_it(tilt):
    for seed in range(50):
        _, body, _, judged = begin(load("B30", **{"camera.tilt": tilt}), seed=seed)
        assert not judged.lost
        assert hypot(body.pose.x, body.pose.y) < 26.0


def test_starts_that_cannot_be():
    with pytest.raises(ModelError) as error:
        begin(load("B30", **{"camera.tilt": 1.0, "camera.fov": 10.0}))
    assert str(error.value) == ("camera: all starts within 50 px are near the horizon\n  hint: tilt it further down")
    with pytest.raises(ModelError) as error:
        begin(load("B60"), (90.0, 0.0))
    assert str(error.value) == "start [90, 0] px: expected a place of the picture below the horizon"
    with pytest.raises(ModelError, match="below the horizon"):
        begin(load("B30"), (0.0, -60.0))
    with pytest.raises(ModelError) as error:
        begin(load("line"), (0.0, 95.0))
    assert str(error.value) == (
        "start [0 px, 95 degrees]: expected a column of the picture and a lean within 90 degrees"
    )
    with pytest.raises(ModelError) as error:
        begin(load("line"), (37.0, 71.0), 1)
    assert str(error.value) == "start [37 px, 71 degrees]: there another side of the hexagon is nearer"


@given(st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), st.floats(-3.1, 3.1), st.sampled_from([1, -1]))
@QUIET
def test_the_line_is_where_a_search_along_it_finds_it(dx, dy, yaw, direction):
    scenario = load("line")
    task, body, view, _ = begin(scenario, (0.0, 0.0), direction)
    pose = Pose(body.pose.x + dx, body.pose.y + dy, 2.4, body.pose.yaw + yaw)
    view.look(pose)
    judged = task.judge(view, pose)
    best, lean = inf, 0.0
    places = [task.path.at(s) for s in np.linspace(0.0, 18.0, 4501)]
    seen = [view.project(x, y, 0.0) for x, y in places]
    for (u0, v0, d0), (u1, v1, d1) in pairwise(seen):
        if d0 > 0 and d1 > 0 and (v0 - 63.0) * (v1 - 63.0) <= 0.0 and v0 != v1:
            u = u0 + (63.0 - v0) / (v1 - v0) * (u1 - u0)
            if abs(u - 63.0) < abs(best - 63.0):
                up = 1.0 if v1 < v0 else -1.0
                best, lean = u, degrees(atan2(up * (u1 - u0), up * (v0 - v1)))
    assert judged.lost == (not view.sees(best, 63.0))
    if not judged.lost:
        assert judged.error == pytest.approx((best - 63.0, lean), abs=0.05)


@pytest.mark.parametrize("name", BALLS)
def test_an_oracle_finishes_ball_laps(name):
    judged, steps = fly(load(name), oracle(6.0), (-30.0, 20.0))
    assert judged.lap
    assert steps == 2000
    assert judged.progress == 1.0


@pytest.mark.parametrize("start", [(20.0, -10.0), (0.0, 60.0), (0.0, -60.0)])
@pytest.mark.parametrize("direction", [1, -1])
def test_an_oracle_finishes_line_laps_in_both_directions(direction, start):
    judged, steps = fly(load("line"), oracle(4.0), start, direction)
    assert judged.lap
    assert 3500 < steps < 5500  # of 4800 at 0.075 m/s; in a turn the aim is swung forward along the next side


@pytest.mark.parametrize("name", BALLS)
def test_doing_nothing_scores_nowhere(name):
    scenario = load(name)
    for du in (-60.0, -35.0, -15.0, 0.0, 20.0, 60.0):
        for dv in (-20.0, 0.0, 30.0, 60.0):
            assert not fly(scenario, nothing, (du, dv))[0].lap


@pytest.mark.parametrize("action", [(0, 0), (0.2, 0), (-1, 0), (0, 0.3), (0, 1), (0, -1), (0.1, 1), (-0.02, 0.02)])
@pytest.mark.parametrize("direction", [1, -1])
def test_one_action_all_the_time_scores_no_line(action, direction):
    for start in ((0.0, 0.0), (-30.0, 10.0), (35.0, -30.0)):
        assert not fly(load("line"), lambda step, judged: action, start, direction)[0].lap


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("du", [-10.0, 0.0, 10.0])
def test_a_circle_of_the_length_of_the_line_scores_nothing(du, direction):
    """One action all the time: within 20 px of the line, all round, but its heading follows no side."""
    judged, _ = fly(load("line"), lambda step, judged: (0.0727 * direction, -0.0334 * direction), (du, 0.0), direction)
    assert judged.progress == 1.0
    assert not judged.lost
    assert not judged.lap


@pytest.mark.parametrize(("shift", "lean"), [(25.0, 0.0), (0.0, 14.0)])
def test_a_lap_of_the_line_needs_small_errors(shift, lean):
    """Who follows beside the line, or askew, goes round, and scores within 20 px and 11.25 degrees only."""

    def askew(share):
        def act(step, judged):
            a, b = judged.scaled
            return oracle(4.0)(step, judged._replace(scaled=(a - share * shift / 64.0, b - share * lean / 90.0)))

        return act

    for share in (0.5, 1.0):
        judged, _ = fly(load("line"), askew(share), (0.0, 0.0), 1)
        assert judged.progress == 1.0
        assert not judged.lost
        assert judged.lap == (share < 1.0)


@pytest.mark.parametrize("name", ["A30", "A60"])
def test_a_camera_over_a_small_star_scores_nowhere(name):
    scenario = load(name)
    for place in ((0.0, 0.0), (0.2, 0.0), (0.15, 0.15), (0.0, -0.4), (0.3, -0.1)):
        judged = moved(scenario, lambda time, task, place=place: place)
        assert judged.done
        assert not judged.lost
        assert not judged.lap


@given(st.floats(0.1, 0.5), st.floats(1.5, 9.0), st.sampled_from([1, -1]), st.floats(0, 2 * pi), st.booleans())
@settings(deadline=None, max_examples=12)
def test_flying_round_or_to_and_fro_without_regard_to_the_ball_scores_nothing(radius, rate, way, phase, fro):
    scenario = load("A60")
    lap = scenario.task.lap / scenario.task.speed

    def place(time, task):
        angle = way * rate * 2 * pi * time / lap + phase
        return radius * cos(angle), (0.3 if fro else 1.0) * radius * sin(angle)

    judged = moved(scenario, place)
    assert not judged.lap


@pytest.mark.parametrize(("start", "lap"), [((0.0, 0.0), True), ((17.5, 17.5), False), ((-35.0, 35.0), False)])
def test_a_circle_in_the_time_of_the_ball_scores_blindly_but_only_from_a_start_near_it(start, lap):
    """On the fixed path the ball always begins at the same place."""
    scenario = load("A60")
    turn = 2 * pi * scenario.task.speed / scenario.task.lap * scenario.step / 1000.0
    most = 0.42 * 2 * pi * scenario.task.speed / scenario.task.lap / scenario.drone.v_max

    def circle(step, judged):
        return -most * cos(turn * step), most * sin(turn * step)

    assert fly(scenario, circle, start)[0].lap == lap


def test_following_behind_the_ball_scores_until_it_is_too_far():
    scenario = load("A60")
    assert moved(scenario, lambda time, task: task.path.at(task.way - 0.05 * 3.0)).lap
    assert not moved(scenario, lambda time, task: task.path.at(task.way - 0.2 * 3.0)).lap


def test_flying_sideways_along_the_hexagon_does_not_score():
    """The heading stays; only the sides that it goes along count, up to where the line is lost."""
    scenario = load("line")

    def sideways(step, judged):
        return oracle(4.0)(step, judged)[0], 0.0

    for direction in (1, -1):
        judged, _ = fly(scenario, sideways, (0.0, 0.0), direction)
        assert not judged.lap
        assert judged.progress < 0.6


def test_ways_back_are_taken_off_and_a_slow_flight_ends():
    scenario = load("line")
    task, body, view, _ = begin(scenario, (0.0, 0.0), 1)
    pose, c, s = body.pose, cos(body.pose.yaw), sin(body.pose.yaw)
    for k in range(400):
        task.advance(0.05)
        way = 0.02 if k % 2 else -0.02
        pose.x, pose.y = pose.x + way * c, pose.y + way * s
        view.look(pose)
        judged = task.judge(view, pose)
    assert judged.progress == pytest.approx(0.0, abs=1e-9)
    task.advance(1.5 * 18.0 / 0.075)
    judged = task.judge(view, pose)
    assert judged.done
    assert not judged.lap


def test_what_is_lost_has_finite_errors():
    scenario = load("B60")
    task, body, view, _ = begin(scenario, (10.0, -5.0))
    pose = Pose(body.pose.x + 50.0, body.pose.y, 2.4)
    view.look(pose)
    judged = task.judge(view, pose)
    assert judged.lost
    assert judged.reward == 0.0
    assert judged.target == border((10.0, -5.0)) == (127.5, -1.5)
    assert judged.scaled == (1.0, -1.0)
    scenario = load("line")
    task, body, view, _ = begin(scenario, (-10.0, 5.0), 1)
    pose = Pose(50.0, 50.0, 2.4)
    view.look(pose)
    judged = task.judge(view, pose)
    assert judged.lost
    assert judged.error == pytest.approx((-64.5, 5.0))


def replayed(scenario, course):
    """Laps of the test that a flight scores which the oracle flew on the fixed path, one for each direction."""
    flown = {}
    for direction in {start.direction for start in grid(scenario)}:
        actions = flown[direction] = []

        def recorded(step, judged, actions=actions):
            actions.append(oracle(4.0)(step, judged))
            return actions[-1]

        assert fly(scenario, recorded, (0.0, 0.0), direction)[0].lap

    def replay(actions):
        return lambda step, judged: actions[step] if step < len(actions) else (0.0, 0.0)

    starts = grid(scenario, course=course)
    return sum(fly(scenario, replay(flown[s.direction]), s.error, s.direction, varied=s.path)[0].lap for s in starts)


def test_a_recorded_flight_scores_on_the_path_that_it_knows_only():
    line, ball = load("line", step=100), load("B60", step=100)
    assert replayed(line, FlightCourse("fixed")) >= 8
    assert replayed(ball, FlightCourse("fixed")) >= 1  # from the start that it knows
    for seed in (0, 1, 4):
        assert replayed(line, FlightCourse(seed=seed)) <= 1
        assert replayed(ball, FlightCourse(seed=seed)) <= 1


@pytest.mark.parametrize("name", ["B60", "line"])
def test_an_oracle_finishes_all_laps_of_varied_paths(name):
    scenario = load(name, step=100)
    for start in grid(scenario):
        assert fly(scenario, oracle(4.0), start.error, start.direction, varied=start.path)[0].lap


def test_a_circle_in_the_time_of_the_ball_scores_no_varied_path():
    scenario = load("A60", step=100)
    turn = 2 * pi * scenario.task.speed / scenario.task.lap * scenario.step / 1000.0
    most = 0.42 * 2 * pi * scenario.task.speed / scenario.task.lap / scenario.drone.v_max

    def circle(step, judged):
        return -most * cos(turn * step), most * sin(turn * step)

    laps = [fly(scenario, circle, s.error, varied=s.path)[0].lap for s in grid(scenario)]
    assert sum(laps) <= 1


@given(st.floats(0.7, 1.4), st.floats(-180, 180), st.floats(0.7, 1.4), st.floats(0, 1))
@settings(deadline=None, max_examples=12)
def test_a_ball_on_a_varied_path(scale, turn, speed, begin_at):
    """It goes as fast and as far as it should, from where it should; a start is where it is wished all the same."""
    scenario, varied = load("B60"), Variation(scale, turn, 1.0, speed, begin_at)
    task, *_, judged = begin(scenario, (20.0, -10.0), varied=varied)
    assert judged.error == pytest.approx((20.0, -10.0), abs=1e-9)
    fixed, angle = begin(scenario)[0].path, turn * pi / 180
    x, y = fixed.at(begin_at * 7.5)
    ball = scale * (x * cos(angle) - y * sin(angle)), scale * (x * sin(angle) + y * cos(angle))
    assert task.scene().ball[:2] == pytest.approx(ball, abs=1e-9)
    assert task.path.length == pytest.approx(7.5 * scale)
    task.advance(0.05)
    assert task.way == pytest.approx(0.075 * 0.05 * speed)


@given(st.floats(0.8, 2.5), st.floats(-180, 180), st.floats(1 / 1.2, 1.2), st.floats(0.7, 1.4), st.floats(-0.3, 0.3))
@settings(deadline=None, max_examples=12)
def test_a_varied_line(scale, turn, stretch, speed, begin_at):
    """It has the area of a hexagon that is larger by the scale, and is flown along at its speed."""
    scenario, varied = load("line"), Variation(scale, turn, stretch, speed, begin_at)
    for direction in (1, -1):
        task, _, view, judged = begin(scenario, (5.0, -5.0), direction, varied=varied)
        assert judged.error == pytest.approx((5.0, -5.0), abs=1e-3)
        x, y = task.path.points.T
        area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
        assert area == pytest.approx(direction * 1.5 * 3**0.5 * 9 * scale**2)
        assert task.forward == pytest.approx(0.075 * speed)
        u, v, _ = view.project(*np.array([0.5 - begin_at, 0.5 + begin_at]) @ task.path.points[:2], 0.0)
        assert (u, v) == pytest.approx((68.0, 63.0), abs=1e-6)


def test_the_path_does_not_stay_varied():
    task, *_ = begin(load("line"), (0.0, 0.0), 1, varied=Variation(2.0, 30.0, 1.2, 1.3, 0.1))
    fresh, *_ = begin(load("line"), (0.0, 0.0), 1)
    task.reset(np.random.default_rng(0), (0.0, 0.0), 1)
    assert (task.path.points == fresh.path.points).all()
    assert task.forward == fresh.forward == 0.075
