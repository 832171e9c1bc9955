"""Running slices on several threads; every slice ends in a barrier."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from neuro.program import Ints
from neuro_event import loop


class Threads:
    """Runs the loop on n threads. No spike needs less than a slice to arrive, so a slice needs no exchange."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._pool = ThreadPoolExecutor(n - 1) if n > 1 else None

    def run(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float) -> int:
        """Run the steps first:last; return where there was no room to go on, or `last`."""
        if self._pool is None:
            return int(loop.run(view, first, last, longest, reach, h))
        step = first
        while step < last:
            steps = int(loop.has_room(view, step, min(longest, last - step), reach))
            if steps < 1:
                return step
            others = [self._pool.submit(loop.run_slice, view, k, step, step + steps, h) for k in range(1, self._n)]
            loop.run_slice(view, 0, step, step + steps, h)
            for other in others:
                other.result()
            step += steps
        for thread in range(self._n):
            loop.finish(view, thread, last - 1, h)
        return last
