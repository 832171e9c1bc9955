"""Figures of a run, from a simulation or from results.

```python
from neuro import plots

figure = plots.raster(sim, of=["exc", "inh"], window=(100.0, 200.0))
```
Each function returns a Matplotlib figure, or draws into the axes `ax`. No function opens a window, changes a setting
of Matplotlib or keeps a reference. If there are too many items, a figure shows some of the items, and the title has
the number of items shown.
"""

from neuro.plots._spikes import cv, isi, raster, rate
from neuro.plots._traces import overview, trace, weights

__all__ = ["cv", "isi", "overview", "raster", "rate", "trace", "weights"]
