"""How high a ball is, and how large, along time."""

from __future__ import annotations

from math import cos, pi, sin, sqrt

from neuro_drone.parts import GRAVITY, Ball

__all__ = ["hop"]


def hop(ball: Ball, time: float) -> tuple[float, float]:
    """Height of a ball's middle and its radius, m.

    A slow rise is half a wave of a cosine; jumps are parabolas, one after the other, as of a ball that loses nothing.

    Args:
        ball: of the scenario.
        time: since the start of the episode, s; the ball then lies on the ground and has its own radius.
    """
    radius = up = ball.radius
    if ball.swell:
        radius = up = ball.radius * (1.0 + ball.swell * sin(2.0 * pi * time / ball.swell_time))
    if ball.rise:
        up += 0.5 * ball.rise * (1.0 - cos(2.0 * pi * time / ball.rise_time))
    if ball.bounce:
        share = time / sqrt(8.0 * ball.bounce / GRAVITY) % 1.0
        up += 4.0 * ball.bounce * share * (1.0 - share)
    return up, radius
