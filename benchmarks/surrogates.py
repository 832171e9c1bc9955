"""Width of the surrogate in a recurrent network: direction of its gradient, and effect of a step against it.

    python benchmarks/surrogates.py FSDD [--out benchmarks/measured/surrogates.yaml]

A recurrent network learns spoken digits for eight epochs with the slope 4. With these weights and the same 600
recordings, the gradient of the recurrent weights is computed with each slope. The figures are its norm, its cosine with
the gradient of slope 8, and the least loss after steps against it of 0.3 to 4 % of the norm of the weights, beside the
loss before. Then the network, and a network without recurrent synapses, learn with each slope from the beginning. FSDD
is the Free Spoken Digit Dataset, a folder or zip. The fold is the first of split seed 7, tested on its validation part.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
import yaml

import neuro_torch
from neuro_bench import METHODS, TASKS
from neuro_bench.spiking import OUTPUT, batch_data
from neuro_train.trainer import learn

SLOPES = (1.0, 2.0, 4.0, 8.0, 16.0)
SETTINGS = {"shift": 0, "batch": 50, "rate": 0.02}
STEPS = (0.003, 0.01, 0.02, 0.04)


def at_one_state(train, part="hidden_hidden"):
    """Return, by slope, the norm and direction of the gradient, and the loss after a step against it."""
    method = METHODS["recurrent"]()
    settings = {**method.settings, **SETTINGS, "epochs": 8}
    net = learn(method.network(train, settings, 0), batch_data(train), method.plan(train, settings, 0)).net
    some = train.take(np.random.default_rng(0).permutation(train.recordings)[:600], 1)
    events, labels = batch_data(some).events, torch.from_numpy(some.labels)
    gradients, found = {}, {}
    for slope in SLOPES:
        module = neuro_torch.Module(net, list(net.projections), slope=slope, outputs=[OUTPUT])

        def loss(module=module):
            spikes = module(events).spikes[OUTPUT]
            return neuro_torch.losses.count_cross_entropy(spikes, labels, scale=1.0 / settings["temperature"])

        before = loss()
        before.backward()
        weight = module.weights[part]
        gradient, kept = weight.grad.clone(), weight.detach().clone()
        after = []
        with torch.no_grad():
            for step in STEPS:
                weight.copy_(kept - gradient * (step * kept.norm() / gradient.norm()))
                after.append(float(loss()))
        gradients[slope] = gradient / gradient.norm()
        found[slope] = {"norm": float(gradient.norm()), "loss": float(before.detach()), "after": min(after)}
    for slope, words in found.items():
        words["cosine with 8"] = float((gradients[slope] * gradients[8.0]).sum())
    return found


def learnt(fold, name, slope):
    """Return the share of right decisions in the validation part after 16 epochs, in %."""
    method = METHODS[name]()
    model = method.fit(fold.train, {**method.settings, **SETTINGS, "epochs": 16, "slope": slope}, 0)
    return 100.0 * float(np.mean(model.predict(fold.validation) == fold.validation.labels))


def main():
    """Measure all slopes, print the figures and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    fold = TASKS["spoken-digits"](asked.data, "random", 7).folds()[0]
    found = {"command": "python benchmarks/surrogates.py FSDD", "recurrent weights, by slope": at_one_state(fold.train)}
    print(yaml.safe_dump(found, sort_keys=False), flush=True)
    for name in ("recurrent", "dense"):
        found[f"{name}, right in %"] = {slope: learnt(fold, name, slope) for slope in SLOPES}
        print(name, found[f"{name}, right in %"], flush=True)
    if asked.out:
        asked.out.write_text(yaml.safe_dump(found, sort_keys=False))


if __name__ == "__main__":
    main()
