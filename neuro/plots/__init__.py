"""Pictures of a run: of a simulation, or of the results that one has left.

```python
from neuro import plots

figure = plots.raster(sim, of=["exc", "inh"], window=(100.0, 200.0))
```
Each function gives a figure of matplotlib, or draws into the axes `ax` that it is given. None opens a window, changes a
setting of matplotlib or keeps anything; what is too much to be drawn is drawn in part, and the picture says so.
"""

from neuro.plots._spikes import cv, isi, raster, rate
from neuro.plots._traces import overview, trace, weights

__all__ = ["cv", "isi", "overview", "raster", "rate", "trace", "weights"]
