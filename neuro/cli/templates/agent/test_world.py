"""Run with python -m pytest. Then change the world or the agent, and state here what must stay true."""

from gymnasium.utils.env_checker import check_env
from train import trained
from world import Room


def test_the_world_is_what_gymnasium_expects():
    check_env(Room(), skip_render_check=True)


def test_it_learns_to_keep_the_room_warm():
    before, after = (trained(steps).test(Room(), episodes=5).mean for steps in (1, 4000))
    assert after > before + 20.0
