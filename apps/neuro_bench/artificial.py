"""Opponents by gradients that do not spike: a small convolutional network, a GRU, and the first in 8 bits."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro_bench.costs import Costs, arithmetic
from neuro_bench.task import Examples, Method, check_installed

if TYPE_CHECKING:
    from torch import Tensor, nn

AT_ONCE = 256


class CNN(Method):
    """Three convolutions with pooling, and a layer of classes."""

    called_by = "cnn"
    title = "convolutional network, float32 (torch)"
    settings = {
        "maps": 12, "epochs": 20, "rate": 0.004, "decay": 0.01, "dropout": 0.3, "shift": 2, "warp": 0.0, "norm": False,
        "members": 1,
    }  # fmt: skip
    space = {
        "maps": (8, 12),
        "epochs": (20, 30),
        "rate": (0.002, 0.004, 0.008),
        "dropout": (0.2, 0.4),
        "shift": (1, 2, 4),
    }

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Network:
        """Learn from examples; see `Method`."""
        return Network(summed(self._members(train, settings, seed)), "float32")

    def _members(self, train: Examples, settings: Mapping[str, Any], seed: int) -> list[Any]:
        check_installed(self, "torch")
        from torch import nn

        channels, rows, columns = train.frames.shape[1:]
        maps = settings["maps"]

        def block(inward: int, outward: int) -> list[Any]:
            norm = [nn.BatchNorm2d(outward)] if settings["norm"] else []
            return [nn.Conv2d(inward, outward, 3, padding=1), *norm, nn.ReLU(), nn.MaxPool2d(2, ceil_mode=True)]

        sides = [-(-side // 8) for side in (rows, columns)]

        def make() -> Any:
            blocks = [*block(channels, maps), *block(maps, 2 * maps), *block(2 * maps, 4 * maps)]
            last = nn.Linear(4 * maps * sides[0] * sides[1], len(train.classes))
            return nn.Sequential(*blocks, nn.Flatten(), nn.Dropout(settings["dropout"]), last)

        return members(make, train, settings, seed)


class QuantisedCNN(CNN):
    """The same network; weights and what comes into each layer are rounded to 8 bits after training."""

    called_by = "cnn-int8"
    title = "the convolutional network in 8 bits, quantised after training"

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Network:
        """Learn from examples, then quantise by their largest values; see `Method`."""
        shown = train.take(np.arange(min(train.recordings, AT_ONCE)), 1)
        return Network(summed([quantised(one, shown) for one in self._members(train, settings, seed)]), "int8")


class GRU(Method):
    """Gated recurrent units that see a column of the frames after the other."""

    called_by = "gru"
    title = "gated recurrent units over the columns, float32 (torch)"
    settings = {"units": 64, "epochs": 25, "rate": 0.006, "decay": 0.01, "shift": 2}
    space = {"units": (48, 64, 96), "epochs": (25, 35), "rate": (0.003, 0.006, 0.012), "shift": (1, 2, 4)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Network:
        """Learn from examples; see `Method`."""
        check_installed(self, "torch")
        from torch import nn

        class Recurrent(nn.Module):
            def __init__(self) -> None:
                super().__init__()
                self.gru = nn.GRU(int(np.prod(train.frames.shape[1:3])), settings["units"], batch_first=True)
                self.out = nn.Linear(settings["units"], len(train.classes))

            def forward(self, x: Tensor) -> Any:
                states, _ = self.gru(x.flatten(1, 2).transpose(1, 2))
                return self.out(states.mean(dim=1))

        return Network(learnt(Recurrent, train, settings, seed), "float32")


def members(make: Any, train: Examples, settings: Mapping[str, Any], seed: int) -> list[Any]:
    """Sequences that have learnt, from other first weights each; batch normalisation is made part of convolutions."""
    from torch import nn
    from torch.nn.utils.fusion import fuse_conv_bn_eval

    found = []
    for k in range(settings["members"]):
        layers: list[Any] = []
        for layer in learnt(make, train, settings, seed + 1000 * k):
            if isinstance(layer, nn.BatchNorm2d):
                layers[-1] = fuse_conv_bn_eval(layers[-1], layer)
            else:
                layers.append(layer)
        found.append(nn.Sequential(*layers).eval())
    return found


def summed(modules: list[Any]) -> Any:
    """A module that says the sum of what others say."""
    from torch import nn

    class Sum(nn.ModuleList):
        def forward(self, x: Tensor) -> Any:
            return sum(one(x) for one in self)

    return Sum(modules)


def learnt(make: Any, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
    """A module that has learnt: cross-entropy, batches of 32, frames shifted and warped at random.

    An epoch shows each recording once, in one version after the other.
    """
    import torch

    def loss(module: Any, chosen: Any, epoch: int, rng: np.random.Generator) -> Tensor:
        version = chosen + epoch % train.versions * train.recordings
        frames = warped(train.frames[version], settings["shift"], settings.get("warp", 0.0), rng)
        return torch.nn.functional.cross_entropy(module(frames), torch.from_numpy(train.labels[version]))

    return optimised(make, loss, train.recordings, 32, settings, seed)


def optimised(make: Any, loss: Any, count: int, batch: int, settings: Mapping[str, Any], seed: int) -> nn.Module:
    """A module that has learnt by AdamW, in one cycle of the learning rate.

    Args:
        make: makes the module.
        loss: of the module, the indices of a batch, the epoch, and a generator of random numbers.
        count: of what is learnt from, each once in an epoch.
        batch: how many at once.
        settings: `rate`, `decay` and `epochs`.
        seed: of all that is random.
    """
    import torch

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        module: nn.Module = make()
        batches = -(-count // batch)
        steps = batches * settings["epochs"]
        optimiser = torch.optim.AdamW(module.parameters(), lr=settings["rate"], weight_decay=settings["decay"])
        cycle = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings["rate"], total_steps=steps)
        rng = np.random.default_rng((seed, 3))
        module.train()
        for epoch in range(settings["epochs"]):
            order = rng.permutation(count)
            for k in range(batches):
                optimiser.zero_grad()
                loss(module, order[k * batch : (k + 1) * batch], epoch, rng).backward()
                optimiser.step()
                cycle.step()
    return module.eval()


def warped(frames: Any, most: int, warp: float, rng: np.random.Generator) -> Tensor:
    """Frames that are also turned (rad), made larger and sheared (shares) at random by up to `warp`; nearest pixels."""
    import torch

    if not warp:
        return torch.from_numpy(shifted(frames, most, rng))
    n, _, rows, columns = frames.shape
    turn, larger, shear = rng.uniform(-warp, warp, (3, n))
    moves = rng.uniform(-2.0 * most, 2.0 * most, (n, 2)) / (columns, rows)
    cos, sin, larger = np.cos(turn), np.sin(turn), 1.0 + larger
    rule = np.stack([cos * larger, shear - sin, moves[:, 0], sin, cos * larger, moves[:, 1]], axis=1)
    grid = torch.nn.functional.affine_grid(
        torch.from_numpy(rule.reshape(n, 2, 3).astype(np.float32)), list(frames.shape), align_corners=False
    )
    return torch.nn.functional.grid_sample(torch.from_numpy(frames), grid, mode="nearest", align_corners=False)


def shifted(frames: Any, most: int, rng: np.random.Generator) -> Any:
    """Frames moved at random along rows and columns, with 0 where nothing comes in."""
    if not most:
        return frames
    rows, columns = frames.shape[2:]
    padded = np.pad(frames, ((0, 0), (0, 0), (most, most), (most, most)))
    moves = rng.integers(0, 2 * most + 1, (len(frames), 2))
    return np.stack([one[:, r : r + rows, c : c + columns] for one, (r, c) in zip(padded, moves, strict=True)])


class Network:
    """A module of torch that says a class.

    Args:
        module: it.
        kind: of its numbers, as in `neuro_bench.costs`.
    """

    def __init__(self, module: nn.Module, kind: str) -> None:
        self.module, self._kind = module, kind

    def predict(self, shown: Any) -> Any:
        """The class of each of `Examples`."""
        import torch

        with torch.no_grad():
            parts = torch.split(torch.from_numpy(shown.frames), AT_ONCE)
            return torch.cat([self.module(part).argmax(dim=1) for part in parts]).numpy()

    def costs(self, shown: Any) -> Costs:
        """Counted layer by layer, where neither the weight nor what comes in is 0, as NeuroBench does."""
        from torch import nn

        counted = dict.fromkeys(("macs", "dense", "zeros", "activations"), 0.0)

        def synapses(layer: Any, given: Any, out: Any) -> None:
            counted["macs"] += _effective(layer, given[0], out)
            counted["dense"] += _effective(layer, given[0], out, whole=True)

        def activations(layer: Any, given: Any, out: Any) -> None:
            counted["zeros"] += float((out == 0).sum())
            counted["activations"] += out.numel()

        hooks = []
        for layer in self.module.modules():
            if isinstance(layer, (nn.Linear, nn.Conv2d, nn.GRU)):
                hooks.append(layer.register_forward_hook(synapses))
            elif isinstance(layer, nn.ReLU):
                hooks.append(layer.register_forward_hook(activations))
        self.predict(shown)
        for hook in hooks:
            hook.remove()
        each = list(self.module.parameters())
        weights = [one for one in each if one.dim() > 1]
        count, zeros = sum(one.numel() for one in weights), sum(int((one == 0).sum()) for one in weights)
        size = sum(one.numel() for one in each)
        macs = counted["macs"] / len(shown)
        return Costs(
            parameters=size,
            footprint_bytes=4 * size - (3 * count if self._kind == "int8" else 0),  # biases stay in 32 bits
            connection_sparsity=round(zeros / count, 4),
            activation_sparsity=counted["zeros"] / counted["activations"] if counted["activations"] else 0.0,
            effective_macs=macs,
            dense=counted["dense"] / len(shown),
            joules=arithmetic(self._kind, macs, counted["dense"] / len(shown)),
        )


def _effective(layer: Any, given: Tensor, out: Any, whole: bool = False) -> float:
    """Products of a layer whose factors are not 0: what it gives if these are 1 and it has no bias."""
    import torch
    from torch.nn import functional as f

    def ones(values: Tensor) -> Tensor:
        return (
            torch.ones_like(values) if whole else (values != 0).to(torch.float64 if values.dim() < 4 else torch.float32)
        )

    if isinstance(layer, torch.nn.Conv2d):
        made = f.conv2d(ones(given), ones(layer.weight), None, layer.stride, layer.padding)
        return float(made.double().sum())
    if isinstance(layer, torch.nn.Linear):
        return float((ones(given).double() @ ones(layer.weight).double().T).sum())
    states = out[0][:, :-1]
    inward, back = ones(layer.weight_ih_l0).double().sum(dim=0), ones(layer.weight_hh_l0).double().sum(dim=0)
    return float((ones(given).double() @ inward).sum() + (ones(states).double() @ back).sum())


def quantised(module: Any, shown: Examples) -> nn.Module:
    """The layers of a sequence in 8 bits: a grid of weights for each output, one for what comes in."""
    import torch
    from torch import nn

    class Rounding(nn.Module):
        def __init__(self, largest: float) -> None:
            super().__init__()
            self.scale = max(largest, 1e-12) / 127.0

        def forward(self, x: Tensor) -> Tensor:
            return (x / self.scale).round().clamp(-127, 127) * self.scale

    made, x = [], torch.from_numpy(shown.frames)
    with torch.no_grad():
        for layer in copy.deepcopy(module):
            if isinstance(layer, (nn.Linear, nn.Conv2d)):
                made.append(Rounding(float(x.abs().max())))
                rows = layer.weight.flatten(1).abs().amax(dim=1).clamp_min(1e-12) / 127.0
                scale = rows.reshape(-1, *[1] * (layer.weight.dim() - 1))
                layer.weight.copy_((layer.weight / scale).round() * scale)
            made.append(layer)
            x = layer(x)
    return nn.Sequential(*made).eval()
