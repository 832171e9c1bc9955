"""PPO of stable-baselines3 learns to keep a ball in a drone's picture: `python drone_ppo.py [steps]`.

The environment is a plain gymnasium one, so any such package can train on it. `pip install '.[rl]'`.
"""

import sys

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO

import neuro_drone  # noqa: F401  tells gymnasium of neuro/Drone-v0

torch.set_num_threads(1)  # the networks are small: more threads only wait for each other
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
env = gymnasium.wrappers.FlattenObservation(gymnasium.make("neuro/Drone-v0", scenario="B60", observation="binary"))
agent = PPO("MlpPolicy", env, n_steps=256, gamma=0.9, seed=0, device="cpu").learn(steps)

seen, info = env.reset(seed=1, options={"start": (30.0, -30.0)})
errors, over = [], False
while not over:
    action, _ = agent.predict(seen, deterministic=True)
    seen, reward, lost, end, info = env.step(action)
    errors.append(info["error_px"])
    over = lost or end
print(f"after {steps} steps: mean error {np.mean(errors):.1f} px in {len(errors)} steps, ball lost: {lost}")
