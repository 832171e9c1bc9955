"""Agent: spiking neurons learn by reward in an environment of your own. Next: python -m pytest."""

from pathlib import Path

from world import Room

import neuro_agent

FILE = Path(__file__).with_name("agent.h5")


def trained(steps, seed=1):
    """Return an agent that has learnt for a number of control steps."""
    env = Room()
    agent = neuro_agent.ActorCritic(env.observation_space, env.action_space, seed=seed)
    agent.train(env, steps=steps)  # other settings: ActorCritic(..., fields=8)
    return agent


if __name__ == "__main__":
    before, after = trained(steps=1), trained(steps=5000)
    for name, agent in (("untrained", before), ("trained", after)):
        print(f"{name}: {agent.test(Room(), episodes=10).mean:.0f} of 100 steps at 20 degrees")
    after.save(FILE)
