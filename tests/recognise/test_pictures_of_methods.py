"""Pictures of what methods have learnt: filters as strong as weights, prototypes, averages."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from neuro.apps import Evaluation
from neuro.events import Events
from neuro_recognise.detection.boxes import Boxes
from neuro_recognise.parts.banks import gabor_bank
from neuro_recognise.recogniser import fit, method_of
from neuro_recognise.telling.pictures import accuracies, boxes_on_frames, confusion, images, prototypes, reconstructed


def test_pictures_of_templates_and_weights():
    """In the middle of its cell, as strong as it is, and nothing of a negative weight."""
    filters, kernels = gabor_bank((5,), (2.0,), (2.5,), 0.3, (0.0, 45.0))[0], np.zeros((2, 2, 6, 7))
    kernels[0, 1, 2, 3], kernels[1, 0, 4, 4] = 0.5, -1.0
    found = reconstructed(kernels, filters, 2)
    assert found.shape == (2, 12, 14)
    alone = np.zeros((12, 14))
    alone[5 - 2 : 5 + 3, 7 - 2 : 7 + 3] = 0.5 * filters[1]
    np.testing.assert_allclose(found[0], gaussian_filter(np.maximum(alone, 0.0), 1.0, mode="constant"), atol=1e-12)
    assert not found[1].any()
    method, templates = method_of("hfirst", "", {"size": [16, 16], "orientations": 4}), np.full((3, 4 * 16), -1.0)
    templates[1, 2 * 16 + 4 * 1 + 2] = 100.0
    figure = method.pictures({"templates": templates}, ("a", "b", "c"))["templates"]
    images = images_of(figure)
    assert np.unravel_index(images[1].argmax(), (16, 16)) == (6, 10)
    assert not images[0].any()


def images_of(figure):
    return [np.asarray(axis.images[0].get_array()) for axis in figure.axes if axis.images]


@pytest.mark.parametrize("name", ["hats", "tar_hats"])
def test_averages_of_classes(name, learning):
    """Each picture is the sum over polarities of the mean of what recordings of a class show."""
    made = fit(learning, method_of(name, "", {"cell": 17, "radius": 2}))
    figure, shown = made.method.pictures(made.learnt, made.classes)["averages"], made.shown(learning)
    assert [axis.get_title() for axis in figure.axes] == list(made.classes)
    for k, image in enumerate(images_of(figure)):
        vectors = shown.take(np.flatnonzero(shown.labels == k)).stacked("vector")
        cells = vectors.mean(axis=0).reshape(2, 2, 2, 5, 5).sum(axis=2)
        np.testing.assert_allclose(image[5:, :5], cells[1, 0], rtol=1e-5, atol=1e-7)


def test_prototypes_of_each_layer(learning):
    made = fit(learning.take(range(0, 24, 3)), method_of("hots", "", {"layers": 2, "readout": "nearest"}))
    drawn = made.method.pictures(made.learnt, made.classes)
    assert list(drawn) == ["layer-1", "layer-2"]
    first, second = (images_of(figure) for figure in drawn.values())
    centres = made.learnt["centres_0"]
    np.testing.assert_array_equal(first[2], centres[:, :, 1, 2] - centres[:, :, 0, 2])
    assert (len(first), len(second), second[0].shape) == (4, 8, (9, 9))


def test_names_of_classes_are_no_formulas(tmp_path):
    names = ("$\\x_{^%$", "$${")
    table = Evaluation(names, np.array([[3, 1, 0], [1, 2, 1]]))
    events = Events(np.array([1, 2]), np.array([1, 2]), np.array([3, 4]), np.array([1, 0]), (8, 8))
    box = Boxes.of([(0, 10, 0, 0, 1.0, (1.0, 1.0, 3.0, 3.0))])
    for figure in (
        confusion(table, names[0]), accuracies([(names[0], [table]), (names[1], [table])]),
        prototypes(np.ones((2, 1, 3, 3)), names, [0.0]), images(np.ones((2, 3, 3)), names, *names),
        boxes_on_frames(events, box, names, names[0]),
    ):  # fmt: skip
        figure.savefig(tmp_path / "a.png", dpi=20)
