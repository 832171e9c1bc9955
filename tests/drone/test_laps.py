"""Both tasks: paths, starts as wished, judged by geometry, and laps that only following earns."""

from itertools import pairwise
from math import atan2, cos, degrees, hypot, inf, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from drones import begin_lap, lap_of
from neuro_drone.body import Kinematic
from neuro_drone.controllers import make
from neuro_drone.env import ACTIONS, DroneEnv
from neuro_drone.evaluate import Start, grid
from neuro_drone.geometry import CameraView, Pose
from neuro_drone.parts import GRAVITY, Ball
from neuro_drone.paths import FIXED, FlightCourse, Variation, hexagon, star
from neuro_drone.report import axes
from neuro_drone.scenario import NAMES, load
from neuro_drone.tasks import BallTask, LineTask, border, hop

BALLS = [name for name in NAMES if load(name).kind == "ball" and "-" not in name]
FEW, FEWER = settings(max_examples=25), settings(max_examples=12)
HEIGHT = load("B60-height")
laps = st.floats(0.1, 100.0)


# paths


@given(laps, st.floats(-300.0, 300.0), st.integers(-3, 3), st.floats(0.0, 1.0))
@FEW
def test_the_star_has_its_length_is_closed_and_even(lap, s, rounds, share):
    path = star(lap)
    assert path.length == pytest.approx(lap)
    places = np.array([path.at(s) for s in np.linspace(0.0, lap, 2001)])
    assert np.hypot(*np.diff(places, axis=0).T).sum() == pytest.approx(lap, rel=1e-4)
    assert path.at(s + rounds * lap) == pytest.approx(path.at(s), abs=1e-6 * lap)
    (x0, y0), (x1, y1) = path.at(share * lap), path.at((share + 1e-3) * lap)
    assert hypot(x1 - x0, y1 - y0) == pytest.approx(1e-3 * lap, rel=1e-3)


def test_the_star_turns_without_corners_through_its_eight_points():
    points = star(1.0).points
    heading = np.unwrap(np.arctan2(*np.diff(points, axis=0, append=points[:1]).T[::-1]))
    assert np.abs(np.diff(heading)).max() < 0.02
    assert heading[-1] - heading[0] == pytest.approx(2 * pi, abs=0.02)
    radius = np.hypot(*points.T)
    assert ((radius > np.roll(radius, 1)) & (radius >= np.roll(radius, -1))).sum() == 4
    quarter = np.roll(points, -len(points) // 4, 0)
    assert quarter == pytest.approx(points @ np.array([[0.0, 1.0], [-1.0, 0.0]]), abs=1e-5)
    for k in range(8):
        size = radius.max() * (0.5 if k % 2 else 1.0)
        corner = size * np.array([np.cos(k * pi / 4), np.sin(k * pi / 4)])
        assert np.hypot(*(points - corner).T).min() < 1e-3


@given(st.floats(0.1, 50.0), st.sampled_from([1, -1]))
@FEW
def test_the_hexagon(side, direction):
    path = hexagon(side, direction)
    segments = path.segments()
    assert (path.length, segments.shape) == (pytest.approx(6 * side), (6, 4))
    assert segments[:, 2:] == pytest.approx(np.roll(segments[:, :2], -1, 0))
    assert np.hypot(*(segments[:, 2:] - segments[:, :2]).T) == pytest.approx(np.full(6, side))
    assert np.sign(area(path.points)) == direction


def area(points):
    x, y = points.T
    return 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()


# flights without a camera


def begin(scenario, start=None, direction=0, seed=0, varied=FIXED):
    """A task, the drone's body at its start, and its camera."""
    camera = scenario.camera
    view, kind = CameraView(fov=camera.fov, tilt=camera.tilt), BallTask if scenario.kind == "ball" else LineTask
    task = kind(scenario.task, CameraView(fov=camera.fov, tilt=camera.tilt), scenario.drone.height)
    body, pose = Kinematic(scenario.drone), task.reset(np.random.default_rng(seed), start, direction, varied)
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


def moved(scenario, place):
    """Judge a camera that is carried: `place` gives where it aims after some seconds."""
    task, _, view, judged = begin(scenario, (0.0, 0.0))
    view.look(Pose(0.0, 0.0, scenario.drone.height))
    dx, dy = view.ground(63.0, 63.0, scenario.task.radius)
    seconds, time = scenario.step / 1000.0, 0.0
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
@FEW
def test_a_ball_begins_where_it_is_wished(name, du, dv):
    *_, judged = begin(load(name), (du, dv))
    assert (judged.error, judged.error_px) == (pytest.approx((du, dv), abs=1e-9), pytest.approx(hypot(du, dv)))
    assert judged.target == pytest.approx((63 + du, 63 + dv))
    assert judged.reward == pytest.approx(1 - hypot(du, dv) / hypot(64.5, 64.5))


@given(st.floats(-60, 60), st.floats(-45, 45), st.sampled_from([1, -1]))
@FEW
def test_a_line_begins_where_it_is_wished(du, lean, direction):
    *_, judged = begin(load("line"), (du, lean), direction)
    assert (judged.error, judged.scaled) == (pytest.approx((du, lean), abs=1e-6), pytest.approx((du / 64, lean / 90)))
    assert judged.reward == pytest.approx(1 - 0.5 * (abs(du) / 64.5 + abs(lean) / 90))


@given(st.integers(0, 1000))
@FEW
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


@given(st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), st.floats(-3.1, 3.1), st.sampled_from([1, -1]))
@FEW
def test_the_line_is_where_a_search_along_it_finds_it(dx, dy, yaw, direction):
    task, body, view, _ = begin(load("line"), (0.0, 0.0), direction)
    pose = Pose(body.pose.x + dx, body.pose.y + dy, 2.4, body.pose.yaw + yaw)
    view.look(pose)
    judged, best, lean = task.judge(view, pose), inf, 0.0
    seen = [view.project(*task.path.at(s), 0.0) for s in np.linspace(0.0, 18.0, 4501)]
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
def test_an_oracle_finishes_ball_laps_and_doing_nothing_scores_nowhere(name):
    judged, steps = fly(load(name), oracle(6.0), (-30.0, 20.0))
    assert (judged.lap, judged.progress, steps) == (True, 1.0, 2000)
    for du in (-60.0, -35.0, -15.0, 0.0, 20.0, 60.0):
        for dv in (-20.0, 0.0, 30.0, 60.0):
            assert not fly(load(name), lambda step, judged: (0.0, 0.0), (du, dv))[0].lap


@pytest.mark.parametrize("start", [(20.0, -10.0), (0.0, 60.0), (0.0, -60.0)])
@pytest.mark.parametrize("direction", [1, -1])
def test_an_oracle_finishes_line_laps_in_both_directions(direction, start):
    judged, steps = fly(load("line"), oracle(4.0), start, direction)
    assert judged.lap
    assert 3500 < steps < 5500  # of 4800 at 0.075 m/s; in a turn the aim is swung forward along the next side


@pytest.mark.parametrize("action", [(0, 0), (0.2, 0), (-1, 0), (0, 0.3), (0, 1), (0, -1), (0.1, 1), (-0.02, 0.02)])
@pytest.mark.parametrize("direction", [1, -1])
def test_one_action_all_the_time_scores_no_line(action, direction):
    for start in ((0.0, 0.0), (-30.0, 10.0), (35.0, -30.0)):
        assert not fly(load("line"), lambda step, judged: action, start, direction)[0].lap


@pytest.mark.parametrize(("du", "direction"), [(-10.0, 1), (0.0, -1), (10.0, 1)])
def test_a_circle_of_the_length_of_the_line_scores_nothing(du, direction):
    """One action all the time: within 20 px of the line, all round, but its heading follows no side."""
    judged, _ = fly(load("line"), lambda step, judged: (0.0727 * direction, -0.0334 * direction), (du, 0.0), direction)
    assert (judged.progress, judged.lost, judged.lap) == (1.0, False, False)


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
        assert (judged.progress, judged.lost, judged.lap) == (1.0, False, share < 1.0)


@pytest.mark.parametrize("name", ["A30", "A60"])
def test_a_camera_over_a_small_star_scores_nowhere(name):
    for place in ((0.0, 0.0), (0.2, 0.0), (0.15, 0.15), (0.0, -0.4), (0.3, -0.1)):
        judged = moved(load(name), lambda time, task, place=place: place)
        assert (judged.done, judged.lost, judged.lap) == (True, False, False)


@given(st.floats(0.1, 0.5), st.floats(1.5, 9.0), st.sampled_from([1, -1]), st.floats(0, 2 * pi), st.booleans())
@FEWER
def test_flying_round_or_to_and_fro_without_regard_to_the_ball_scores_nothing(radius, rate, way, phase, fro):
    scenario = load("A60")
    lap = scenario.task.lap / scenario.task.speed

    def place(time, task):
        angle = way * rate * 2 * pi * time / lap + phase
        return radius * cos(angle), (0.3 if fro else 1.0) * radius * sin(angle)

    assert not moved(scenario, place).lap


def circle(scenario):
    """Flies round in the time of the ball, without looking."""
    rate = 2 * pi * scenario.task.speed / scenario.task.lap
    turn, most = rate * scenario.step / 1000.0, 0.42 * rate / scenario.drone.v_max
    return lambda step, judged: (-most * cos(turn * step), most * sin(turn * step))


def test_who_follows_behind_or_sideways_or_back():
    """On the fixed path the ball always begins at the same place, on varied ones elsewhere."""
    scenario, coarse = load("A60"), load("A60", step=100)
    for start, lap in (((0.0, 0.0), True), ((17.5, 17.5), False), ((-35.0, 35.0), False)):
        assert fly(scenario, circle(scenario), start)[0].lap == lap
    assert sum(fly(coarse, circle(coarse), s.error, varied=s.path)[0].lap for s in grid(coarse)) <= 1
    scenario = load("A60")
    assert moved(scenario, lambda time, task: task.path.at(task.way - 0.05 * 3.0)).lap
    assert not moved(scenario, lambda time, task: task.path.at(task.way - 0.2 * 3.0)).lap
    for direction in (1, -1):
        judged, _ = fly(load("line"), lambda step, judged: (oracle(4.0)(step, judged)[0], 0.0), (0.0, 0.0), direction)
        assert not judged.lap
        assert judged.progress < 0.6
    task, body, view, _ = begin(load("line"), (0.0, 0.0), 1)
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
    assert (judged.done, judged.lap) == (True, False)
    for name, start, pose, error in (
        ("B60", (10.0, -5.0), Pose(50.0, 0.0, 2.4), (64.5, -64.5)),
        ("line", (-10.0, 5.0), Pose(50.0, 50.0, 2.4), (-64.5, 5.0)),
    ):
        task, _, view, _ = begin(load(name), start, 1)
        view.look(pose)
        judged = task.judge(view, pose)
        assert (judged.lost, judged.reward, judged.error) == (True, 0.0, pytest.approx(error))
    assert border((10.0, -5.0)) == (127.5, -1.5)


def replayed(scenario, course, places):
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

    starts = [start for k, start in enumerate(grid(scenario, course=course)) if k in places]
    return sum(fly(scenario, replay(flown[s.direction]), s.error, s.direction, varied=s.path)[0].lap for s in starts)


@pytest.mark.parametrize(("name", "most"), [("line", 3), ("B60", 1)])
def test_a_recorded_flight_scores_on_the_path_that_it_knows_only(name, most):
    """Of starts in the middle, with the ball of the one that it knows."""
    scenario, middle = load(name, step=100), range(7, 18)
    assert replayed(scenario, FlightCourse("fixed"), middle) >= most
    assert replayed(scenario, FlightCourse(seed=1), range(25)) <= 1


@pytest.mark.parametrize("name", ["B60", "line"])
def test_an_oracle_finishes_laps_of_varied_paths(name):
    scenario = load(name, step=100)
    for start in grid(scenario)[::3]:
        assert fly(scenario, oracle(4.0), start.error, start.direction, varied=start.path)[0].lap


@given(st.floats(0.7, 1.4), st.floats(-180, 180), st.floats(0.7, 1.4), st.floats(0, 1))
@FEWER
def test_a_ball_on_a_varied_path(scale, turn, speed, begin_at):
    """It goes as fast and as far as it should, from where it should; a start is where it is wished all the same."""
    scenario, varied = load("B60"), Variation(scale, turn, 1.0, speed, begin_at)
    task, *_, judged = begin(scenario, (20.0, -10.0), varied=varied)
    assert judged.error == pytest.approx((20.0, -10.0), abs=1e-9)
    fixed, angle = begin(scenario)[0].path, turn * pi / 180
    x, y = fixed.at(begin_at * 7.5)
    ball = scale * (x * cos(angle) - y * sin(angle)), scale * (x * sin(angle) + y * cos(angle))
    assert (task.scene().ball[:2], task.path.length) == (pytest.approx(ball, abs=1e-9), pytest.approx(7.5 * scale))
    task.advance(0.05)
    assert task.way == pytest.approx(0.075 * 0.05 * speed)


@given(st.floats(0.8, 2.5), st.floats(-180, 180), st.floats(1 / 1.2, 1.2), st.floats(0.7, 1.4), st.floats(-0.3, 0.3))
@FEWER
def test_a_varied_line(scale, turn, stretch, speed, begin_at):
    """It has the area of a hexagon that is larger by the scale, and is flown along at its speed."""
    scenario, varied = load("line"), Variation(scale, turn, stretch, speed, begin_at)
    for direction in (1, -1):
        task, _, view, judged = begin(scenario, (5.0, -5.0), direction, varied=varied)
        assert judged.error == pytest.approx((5.0, -5.0), abs=1e-3)
        assert area(task.path.points) == pytest.approx(direction * 1.5 * 3**0.5 * 9 * scale**2)
        assert task.forward == pytest.approx(0.075 * speed)
        u, v, _ = view.project(*np.array([0.5 - begin_at, 0.5 + begin_at]) @ task.path.points[:2], 0.0)
        assert (u, v) == pytest.approx((68.0, 63.0), abs=1e-6)


def test_the_path_does_not_stay_varied():
    task, *_ = begin(load("line"), (0.0, 0.0), 1, varied=Variation(2.0, 30.0, 1.2, 1.3, 0.1))
    fresh, *_ = begin(load("line"), (0.0, 0.0), 1)
    task.reset(np.random.default_rng(0), (0.0, 0.0), 1)
    assert (task.path.points == fresh.path.points).all()
    assert task.forward == fresh.forward == 0.075


# balls that rise, jump and swell


def test_jumps_rise_and_swell():
    ball, h = Ball(bounce=0.2), 1e-3
    up = np.array([hop(ball, t)[0] for t in np.arange(0.0, 1.0, h)]) - ball.radius
    assert (up[0], up.min(), up.max()) == (0.0, 0.0, pytest.approx(0.2, abs=1e-5))
    falls = np.diff(up, 2) / h**2
    assert np.median(falls) == pytest.approx(-GRAVITY, abs=1e-4)
    assert (np.abs(falls + GRAVITY) > 1e-3).sum() <= 2 * 3  # the ground, at two moments
    ball = Ball(radius=0.2, rise=0.6, rise_time=10.0, swell=0.5, swell_time=8.0)
    for time in (0.0, 1.0, 5.0, 10.0, 14.0):
        up, radius = hop(ball, time)
        assert radius == pytest.approx(0.2 * (1.0 + 0.5 * sin(2 * pi * time / 8.0)))
        assert up - radius == pytest.approx(0.3 * (1.0 - cos(2 * pi * time / 10.0)))
        assert hop(Ball(), time) == (0.17, 0.17)
    env = DroneEnv("B60-bounce")
    env.reset(seed=1, options={"start": (0.0, 0.0)})
    seen = []
    for step in range(1, 30):
        info = env.step((0.0, 0.0))[4]
        x, y, z, r = env.task.scene().ball
        assert (z, r) == pytest.approx(hop(env.scenario.task, 0.05 * step))
        assert info["target"] == pytest.approx(env.view.project(x, y, z)[:2])
        seen.append(info["error"][1])
    assert min(seen) < -4.0  # it jumps up the picture
    begin_lap(env, Start((0.0, 0.0)))
    assert env.task.scene().ball[2:] == (0.17, 0.17)
    env, start = DroneEnv("B60-rise"), (20.0, -10.0, 6.0)
    for varied in (Variation(1.3, 70.0, 1.0, 1.4, 0.6), Variation(0.8, -20.0, 1.0, 0.8, 0.1)):
        assert begin_lap(env, Start(start, path=varied))["error"] == pytest.approx(start, abs=1e-3)
        for step in range(1, 20):
            env.step((0.0, 0.0, 0.0))
            place, ball = env.task.scene().ball, env.scenario.task
            assert place[2:] == pytest.approx(hop(ball, 0.05 * step))
            along = varied.begin * env.task.path.length + ball.speed * varied.speed * 0.05 * step
            assert place[:2] == pytest.approx(env.task.path.at(along))


@pytest.mark.parametrize("name", ["B60-height", "B60-rise", "B60-bounce", "B60-wind", "B60-spin"])
def test_an_oracle_finishes_laps_of_what_changes_in_flight(name):
    world = load(name, step=100)
    starts = grid(world, 2)
    assert len({start.path for start in starts}) == 4
    for i in (1, 2):
        lap, env = lap_of(make("oracle", world), world, starts[i], i)
        assert lap.lap
        assert world.axes == 2 or lap.absolute[2] < 2.0
    turned = env.body.pose.yaw / (lap.steps * 0.1)
    assert turned == pytest.approx(0.3 if name == "B60-spin" else 0.0, abs=0.01)  # anticlockwise


# three axes


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.05, 0.6), st.floats(35, 90))
@FEW
def test_tall_is_the_span_of_the_balls_rows(x, y, radius, tilt):
    view = CameraView(tilt=tilt)
    view.look(Pose(0.0, 0.0, 2.4, 0.3))
    right, down, forward, place = view.matrix
    ball = place + 2.5 * forward + x * right + y * down
    middle = ball - place
    far2 = middle @ middle
    # the circle along which rays touch the ball
    a = np.cross(middle, (1.0, 0.2, 0.1))
    a /= np.linalg.norm(a)
    b, angle = np.cross(middle, a) / np.sqrt(far2), np.linspace(0, 2 * np.pi, 721)[:, None]
    wide = radius * np.sqrt(1 - radius**2 / far2)
    circle = ball - radius**2 / far2 * middle + wide * (np.cos(angle) * a + np.sin(angle) * b)
    rows = [view.project(*point)[1] for point in circle]
    assert view.tall(*ball, radius) == pytest.approx(max(rows) - min(rows), abs=2e-3)


@given(st.floats(0, 127), st.floats(0.05, 1.0), st.floats(4, 60))
@FEW
def test_depth_is_that_at_which_a_ball_is_so_tall(v, radius, tall):
    view = CameraView()
    view.look(Pose(1.0, 2.0, 2.4, 0.5))
    middle = view.matrix[3] + view.depth_of(v, radius, tall) * np.array(view.ray(20.0, v))
    assert (view.tall(*middle, radius), view.project(*middle)[1]) == (pytest.approx(tall), pytest.approx(v))
    assert view.tall(1.0, 2.0, 2.4, 0.2) == np.inf  # round the camera


def test_three_axes():
    env = DroneEnv(HEIGHT)
    for start in ((0.0, 0.0, 0.0), (20.0, -10.0, 15.0), (-35.0, 30.0, -12.0)):
        info = env.reset(options={"start": start})[1]
        assert info["error"] == pytest.approx(start)
        assert info["supervised_error"] == pytest.approx((start[0] / 64, start[1] / 64, start[2] / 40))
        away = np.hypot(start[0], start[1]) / np.hypot(64.5, 64.5)
        assert info["reward"] == pytest.approx(1.0 - 0.5 * (away + abs(start[2]) / 40))
        assert env.reset(options={"start": start[:2]})[1]["error"] == pytest.approx((*start[:2], 0.0))
    drawn = np.array([env.reset(seed=seed)[1]["error"] for seed in range(30)])
    assert np.abs(drawn).max(axis=0) == pytest.approx((50, 50, 16), abs=6)
    assert (np.abs(drawn).max(axis=0) <= (50, 50, 16)).all()
    assert axes(HEIGHT) == ("right, px", "down, px", "taller, px")
    assert sorted({start.error[2] for start in grid(HEIGHT)}) == pytest.approx([-12.0, 0.0, 12.0])
    seen = {}
    for name, actions, up, down in (("c", "continuous", (0, 0, 1), (0, 0, -1)), ("d", "discrete", 9, 10)):
        env = DroneEnv(HEIGHT, actions=actions)
        for way, action in (("up", up), ("down", down)):
            env.reset(seed=1, options={"start": (0.0, 0.0, 0.0)})
            z = env.body.pose.z
            for _ in range(5):
                info = env.step(action)[4]
            seen[name, way] = info["error"]
            assert env.body.pose.z > z if way == "up" else env.body.pose.z < z
    assert seen["c", "up"] == seen["d", "up"]
    assert seen["c", "up"][2] < -1.0 < 1.0 < seen["c", "down"][2]
    assert env.action_space.n == len(ACTIONS) + 2
    world = load(HEIGHT, **{"task.ball.lap": 1.5, "task.ball.speed": 0.06})  # 500 steps
    start = Start((0.0, 0.0, 0.3 * 40))
    follows, _ = lap_of(make("oracle", world), world, start)
    assert follows.lap
    assert follows.track.shape == (500, 3)
    assert follows.absolute[2] < 2.0
    env = DroneEnv(world)
    info = begin_lap(env, start)
    flier, over, lost = make("oracle", world), False, False
    while not (over or lost):  # in the middle, but never higher
        _, _, lost, over, info = env.step(flier.act(info["counts"], info) * (1.0, 1.0, 0.0))
    assert (lost, info["lap"]) == (False, False)
    assert info["error_px"] < 5.0


@pytest.mark.parametrize("up", [True, False])
def test_a_ball_half_or_twice_as_tall_is_lost(up):
    env = DroneEnv(HEIGHT)
    env.reset(seed=1, options={"start": (0.0, 0.0, 0.0)})
    lost, rewards = False, []
    while not lost and len(rewards) < 200:
        held = np.clip(4.0 * env.task.judge(env.view, env.body.pose).scaled[1], -1, 1)
        _, reward, lost, _, info = env.step((0.0, held, 1.0 if up else -1.0))
        rewards.append(reward)
    assert lost
    assert abs(info["error"][0]) < 64 > abs(info["error"][1])
    assert info["error"][2] == pytest.approx(-20 if up else 40, abs=3)
    assert rewards[-1] == 0.0 < rewards[-2] < rewards[5]
