"""Spiking agents that learn by reward, for any Gymnasium environment.

import gymnasium
import neuro_agent

env = gymnasium.make("CartPole-v1")
agent = neuro_agent.ActorCritic(env.observation_space, env.action_space, seed=1)
log = agent.train(env, until=475.0)
print(agent.test(env, episodes=100))
"""

from neuro.apps import Log, Test
from neuro_agent.agent import ActorCritic
from neuro_agent.deployed import Deployed, Frozen
from neuro_agent.network import Settings
from neuro_agent.twin import LinearTwin

__all__ = ["ActorCritic", "Deployed", "Frozen", "LinearTwin", "Log", "Settings", "Test"]
