"""What decisions while events arrive need: what was learnt of beginnings, and how good held-out decisions were.

In the file of a recogniser:

```
/early/times_us   moments since the first event, us
/early/margins    (recordings, moments) of held-out recordings
/early/right      (recordings, moments) whether the decision was right
/early/labels     (recordings,) index of the class of each; older files have none
/early/learnt/0   arrays and texts by name, of the first moment; and so on; none where all moments ask what was learnt
                  of whole recordings
```
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro_recognise.deciding.held import Held
from neuro_recognise.method import Learnt

__all__ = ["Early", "part_of"]


@dataclass(frozen=True, eq=False)
class Early:
    """What decisions while events arrive need.

    Attributes:
        held: what was decided of held-out recordings, moment by moment.
        learnt: at each of these moments, of beginnings so long; empty where they are not learnt apart.
    """

    held: Held
    learnt: tuple[Learnt, ...] = ()

    def at(self, after_us: int) -> Learnt | None:
        """What was learnt of beginnings so long: of the last moment before, or the first; None if not apart."""
        if not self.learnt:
            return None
        moment = int(np.searchsorted(self.held.times_us, after_us, "right")) - 1
        return self.learnt[max(0, moment)]

    def write(self, group: Any) -> None:
        """Put it into an open group of a file."""
        group["times_us"], group["margins"], group["right"] = self.held.times_us, self.held.margins, self.held.right
        if self.held.labels is not None:
            group["labels"] = self.held.labels
        for moment, learnt in enumerate(self.learnt):
            for name, part in learnt.items():
                group[f"learnt/{moment}/{name}"] = part

    @classmethod
    def read(cls, group: Any) -> Early:
        """What `write` put there."""
        labels = group["labels"][()] if "labels" in group else None
        held = Held(group["times_us"][()], group["margins"][()], group["right"][()], labels)
        several = group.get("learnt", {})
        learnt = tuple({name: part_of(data) for name, data in several[str(k)].items()} for k in range(len(several)))
        return cls(held, learnt)


def part_of(data: Any) -> Any:
    """An array or a text of a file."""
    return data.asstr()[()] if data.dtype.kind == "O" else data[()]
