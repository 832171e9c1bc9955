"""Non-spiking networks trained by gradients: a small CNN in float32 and in 8 bits, and a GRU."""

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
"""Number of examples processed together."""


class CNN(Method):
    """Three convolutions with pooling and a dense layer with an output for each class."""

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
        return Network(ensemble(self._members(train, settings, seed)), "float32")

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
            output_layer = nn.Linear(4 * maps * sides[0] * sides[1], len(train.classes))
            return nn.Sequential(*blocks, nn.Flatten(), nn.Dropout(settings["dropout"]), output_layer)

        return members(make, train, settings, seed)


class QuantisedCNN(CNN):
    """The CNN with weights and inputs of each layer rounded to 8 bits after training."""

    called_by = "cnn-int8"
    title = "the convolutional network in 8 bits, quantised after training"

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Network:
        """Train on examples, then quantise by the largest activations of the first recordings; see `Method`."""
        calibration = train.take(np.arange(min(train.recordings, AT_ONCE)), 1)
        modules = [quantise(module, calibration) for module in self._members(train, settings, seed)]
        return Network(ensemble(modules), "int8")


class GRU(Method):
    """Gated recurrent units whose input is the columns of the frames, one after another."""

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

        return Network(train_classifier(Recurrent, train, settings, seed), "float32")


def members(make: Any, train: Examples, settings: Mapping[str, Any], seed: int) -> list[Any]:
    """Train `settings["members"]` modules with different initial weights, and fuse batch normalisation into weights.

    Args:
        make: function that returns the layers of an untrained module.
        train: the examples.
        settings: see `train_module`.
        seed: seed of the first module; the next modules have seed + 1000, seed + 2000, and so on.
    """
    from torch import nn
    from torch.nn.utils.fusion import fuse_conv_bn_eval

    modules = []
    for k in range(settings["members"]):
        layers: list[Any] = []
        for layer in train_classifier(make, train, settings, seed + 1000 * k):
            if isinstance(layer, nn.BatchNorm2d):
                layers[-1] = fuse_conv_bn_eval(layers[-1], layer)
            else:
                layers.append(layer)
        modules.append(nn.Sequential(*layers).eval())
    return modules


def ensemble(modules: list[Any]) -> Any:
    """Return a module whose output is the sum of the outputs of the given modules."""
    from torch import nn

    class Sum(nn.ModuleList):
        def forward(self, x: Tensor) -> Any:
            return sum(module(x) for module in self)

    return Sum(modules)


def train_classifier(make: Any, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
    """Train a classifier by cross-entropy in batches of 32, with random shifts and warps of the frames.

    Each recording is used once in an epoch. Epoch k uses version k mod `versions` of all recordings.
    """
    import torch

    def loss(module: Any, chosen: Any, epoch: int, rng: np.random.Generator) -> Tensor:
        version = chosen + epoch % train.versions * train.recordings
        frames = warp_frames(train.frames[version], settings["shift"], settings.get("warp", 0.0), rng)
        return torch.nn.functional.cross_entropy(module(frames), torch.from_numpy(train.labels[version]))

    return train_module(make, loss, train.recordings, 32, settings, seed)


def train_module(make: Any, loss: Any, count: int, batch: int, settings: Mapping[str, Any], seed: int) -> nn.Module:
    """Train a module by AdamW with a one-cycle learning rate.

    Args:
        make: function that returns the untrained module.
        loss: function of the module, the indices of a batch, the epoch and a random generator.
        count: number of examples, each used once in an epoch.
        batch: number of examples in a batch.
        settings: `rate`, `decay` and `epochs`.
        seed: seed of the initial weights, the order of examples and the augmentation.
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


def warp_frames(frames: Any, most: int, warp: float, rng: np.random.Generator) -> Tensor:
    """Shift, rotate, scale and shear frames at random, with nearest-neighbour sampling.

    Args:
        frames: shape (examples, channels, rows, columns).
        most: largest shift, in pixels.
        warp: largest rotation in rad, and largest relative change of size and shear; 0 for shifts only.
        rng: random generator.
    """
    import torch

    if not warp:
        return torch.from_numpy(shift_frames(frames, most, rng))
    n, _, rows, columns = frames.shape
    angle, growth, shear = rng.uniform(-warp, warp, (3, n))
    shift = rng.uniform(-2.0 * most, 2.0 * most, (n, 2)) / (columns, rows)
    cos, sin, scale = np.cos(angle), np.sin(angle), 1.0 + growth
    affine = np.stack([cos * scale, shear - sin, shift[:, 0], sin, cos * scale, shift[:, 1]], axis=1)
    grid = torch.nn.functional.affine_grid(
        torch.from_numpy(affine.reshape(n, 2, 3).astype(np.float32)), list(frames.shape), align_corners=False
    )
    return torch.nn.functional.grid_sample(torch.from_numpy(frames), grid, mode="nearest", align_corners=False)


def shift_frames(frames: Any, most: int, rng: np.random.Generator) -> Any:
    """Shift frames at random along rows and columns by at most `most` pixels. Pixels at the freed borders are 0."""
    if not most:
        return frames
    rows, columns = frames.shape[2:]
    padded = np.pad(frames, ((0, 0), (0, 0), (most, most), (most, most)))
    corners = rng.integers(0, 2 * most + 1, (len(frames), 2))
    return np.stack([frame[:, r : r + rows, c : c + columns] for frame, (r, c) in zip(padded, corners, strict=True)])


class Network:
    """A trained torch module that classifies examples.

    Args:
        module: the module, with an output for each class.
        kind: number format, "float32" or "int8", which determines the energy.
    """

    def __init__(self, module: nn.Module, kind: str) -> None:
        self.module, self._kind = module, kind

    def predict(self, data: Any) -> Any:
        """Return the class of each example."""
        import torch

        with torch.no_grad():
            parts = torch.split(torch.from_numpy(data.frames), AT_ONCE)
            return torch.cat([self.module(part).argmax(dim=1) for part in parts]).numpy()

    def costs(self, data: Any) -> Costs:
        """Return the costs. Only multiply-accumulates with weight and input other than 0 count, as in NeuroBench."""
        from torch import nn

        totals = dict.fromkeys(("macs", "dense", "zeros", "activations"), 0.0)

        def count_synapses(layer: Any, inputs: Any, out: Any) -> None:
            totals["macs"] += _effective(layer, inputs[0], out)
            totals["dense"] += _effective(layer, inputs[0], out, dense=True)

        def count_activations(layer: Any, inputs: Any, out: Any) -> None:
            totals["zeros"] += float((out == 0).sum())
            totals["activations"] += out.numel()

        hooks = []
        for layer in self.module.modules():
            if isinstance(layer, (nn.Linear, nn.Conv2d, nn.GRU)):
                hooks.append(layer.register_forward_hook(count_synapses))
            elif isinstance(layer, nn.ReLU):
                hooks.append(layer.register_forward_hook(count_activations))
        self.predict(data)
        for hook in hooks:
            hook.remove()
        parameters = list(self.module.parameters())
        weights = [array for array in parameters if array.dim() > 1]
        count, zeros = (sum(array.numel() for array in weights), sum(int((array == 0).sum()) for array in weights))
        size = sum(array.numel() for array in parameters)
        macs, dense = totals["macs"] / len(data), totals["dense"] / len(data)
        return Costs(
            parameters=size,
            footprint_bytes=4 * size - (3 * count if self._kind == "int8" else 0),  # biases stay in 32 bits
            connection_sparsity=round(zeros / count, 4),
            activation_sparsity=totals["zeros"] / totals["activations"] if totals["activations"] else 0.0,
            effective_macs=macs,
            dense=dense,
            joules=arithmetic(self._kind, macs, dense),
        )


def _effective(layer: Any, inputs: Tensor, out: Any, dense: bool = False) -> float:
    """Count the products of a layer whose weight and input are both not 0, or all products if `dense`.

    The count is the sum of the layer's outputs without bias when all factors that are not 0 are replaced by 1.
    """
    import torch
    from torch.nn import functional as f

    def ones(values: Tensor) -> Tensor:
        return (
            torch.ones_like(values) if dense else (values != 0).to(torch.float64 if values.dim() < 4 else torch.float32)
        )

    if isinstance(layer, torch.nn.Conv2d):
        products = f.conv2d(ones(inputs), ones(layer.weight), None, layer.stride, layer.padding)
        return float(products.double().sum())
    if isinstance(layer, torch.nn.Linear):
        return float((ones(inputs).double() @ ones(layer.weight).double().T).sum())
    states = out[0][:, :-1]
    inward, recurrent = ones(layer.weight_ih_l0).double().sum(dim=0), ones(layer.weight_hh_l0).double().sum(dim=0)
    return float((ones(inputs).double() @ inward).sum() + (ones(states).double() @ recurrent).sum())


def quantise(module: Any, data: Examples) -> nn.Module:
    """Round a sequence of layers to 8 bits. Weights have a scale for each output, inputs have a scale for each layer.

    Args:
        module: the trained layers.
        data: examples whose largest activations set the scales of the inputs.
    """
    import torch
    from torch import nn

    class Rounding(nn.Module):
        def __init__(self, largest: float) -> None:
            super().__init__()
            self.scale = max(largest, 1e-12) / 127.0

        def forward(self, x: Tensor) -> Tensor:
            return (x / self.scale).round().clamp(-127, 127) * self.scale

    layers, x = [], torch.from_numpy(data.frames)
    with torch.no_grad():
        for layer in copy.deepcopy(module):
            if isinstance(layer, (nn.Linear, nn.Conv2d)):
                layers.append(Rounding(float(x.abs().max())))
                rows = layer.weight.flatten(1).abs().amax(dim=1).clamp_min(1e-12) / 127.0
                scale = rows.reshape(-1, *[1] * (layer.weight.dim() - 1))
                layer.weight.copy_((layer.weight / scale).round() * scale)
            layers.append(layer)
            x = layer(x)
    return nn.Sequential(*layers).eval()
