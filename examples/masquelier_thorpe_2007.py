"""Features emerge without labels: neurons that compete learn the parts of shapes that come often, and others read them.

Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007, whose features of photographs told faces and motorbikes
from background. Here the same rule sees N-MNIST, through ReMuS's filters; a linear support vector machine reads the
features of recordings held out. Chance is 10 %. Writes masquelier_thorpe_2007.png.

    python examples/masquelier_thorpe_2007.py nmnist_train1000_bin.zip
"""

import argparse

import numpy as np

from neuro.events import recordings
from neuro_recognise import fit

options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
options.add_argument("path", help="labelled recordings of an event camera")
options.add_argument("--each", type=int, default=100, help="recordings of a class at most")
asked = options.parse_args()

data = recordings(asked.path)
chosen = [np.flatnonzero(data.labels == label)[: asked.each] for label in range(len(data.classes))]
data = data.take(np.concatenate(chosen))
learn, test = next(iter(data.folds(5, seed=7)))
recogniser = fit(data.take(learn), "masquelier_thorpe", seed=1)

unseen = data.take(test)
right = np.mean(recogniser.predict(unseen) == unseen.labels)
maps = recogniser.learnt["c1_s2"]
print(f"{len(maps)} maps of {maps.shape[-1]} x {maps.shape[-2]} places in four orientations, learnt without labels")
print(f"read by a support vector machine: {right:.1%} of {len(unseen)} recordings held out")
drawings = recogniser.method.pictures(recogniser.learnt, recogniser.classes)
drawings["features"].savefig("masquelier_thorpe_2007.png", dpi=100)
