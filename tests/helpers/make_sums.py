"""Random learning rules of Loihi 2."""

import numpy as np


def drawn_sum(rng: np.random.Generator, every: int, most: int) -> str:
    """Return a random sum of products, all of whose u_k are the same, as lava demands."""
    products = []
    for _ in range(rng.integers(1, most + 1)):
        gate = str(rng.choice(["x0", "y0", f"u{every}"]))
        names = rng.choice(["x1", "x2", "y1", "y2", "y3", "w", "t"], rng.integers(0, 4), replace=False)
        factors = [f"({name} + {rng.integers(1, 99)})" if rng.random() < 0.2 else str(name) for name in names]
        wide = sum(9 if name in ("w", "t") else 7 for name in names) + 4 - 15
        exponent = int(rng.integers(-7, 9)) if rng.random() < 0.2 else max(-7, -6 - min(0, wide) // 3)
        products.append("*".join([f"{rng.integers(1, 8)}*2^{exponent}", gate, *factors]))
    return products[0] + "".join(f" {rng.choice(['+', '-'])} {each}" for each in products[1:])
