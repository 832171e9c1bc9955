"""`Dataset` in PyTorch's `DataLoader`; skipped where PyTorch is missing."""

import warnings

import numpy as np
import pytest

from neuro.events import Dataset, Events, save
from neuro.events.representations import event_frame

torch = pytest.importorskip("torch", reason="PyTorch is not installed")


def picture(events):
    """A tensor-like value that batches are made of."""
    return event_frame(events).astype(np.float32)


def as_lists(batch):
    """Recordings differ in length, so a batch is a list of them."""
    return [events for events, _ in batch], torch.tensor([label for _, label in batch])


@pytest.fixture
def folder(tmp_path):
    for k in range(12):
        path = tmp_path / "set" / "ab"[k % 2] / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        n = 3 + k
        save(Events(np.arange(n), np.full(n, k), np.arange(n), np.ones(n, int), (34, 34)), path)
    return tmp_path / "set"


def places(folder):
    yield Dataset(folder)
    yield Dataset(Dataset(folder).to_hdf5(folder.with_suffix(".h5"), jobs=1).path)


def loader(data, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield from torch.utils.data.DataLoader(data, batch_size=5, **options)


@pytest.mark.parametrize("place", [0, 1])
def test_events_in_lists(folder, place):
    data = list(places(folder))[place]
    data[0]
    batches = loader(data, collate_fn=as_lists, num_workers=1, multiprocessing_context="fork")
    found = [(e, int(label)) for events, labels in batches for e, label in zip(events, labels, strict=True)]
    assert found == list(data)


def test_pictures_in_tensors(folder):
    for data in places(folder):
        batches = list(loader(data.mapped(picture), shuffle=True))
        assert [tuple(x.shape) for x, _ in batches] == [(5, 2, 34, 34), (5, 2, 34, 34), (2, 2, 34, 34)]
        assert sorted(torch.cat([y for _, y in batches]).tolist()) == sorted(data.labels.tolist())


def test_indices_of_torch(folder):
    data = Dataset(folder)
    assert data[torch.tensor(3)][0] == data[3][0]
    assert [s.name for s in data[torch.tensor([3, 1])].samples] == [data.samples[3].name, data.samples[1].name]
    first, second = torch.utils.data.random_split(data, [8, 4], generator=torch.Generator().manual_seed(0))
    assert len(first) + len(second) == len(data)
    assert first[0][1] in (0, 1)
