"""Third-party parts: one `neuro.register`, or an entry point, and they are known like ours."""

import dataclasses
import sys
from dataclasses import dataclass
from functools import partial
from importlib.metadata import EntryPoint, EntryPoints
from types import SimpleNamespace

import numpy as np
import pytest

import neuro
from event_tests import refusal
from neuro.coding import CODES, RATE_CODES
from neuro.core import registry
from neuro.events import Events, load, save, stream
from neuro.events.dataset import Dataset
from neuro.events.filters import FILTERS, Crop, Filter, Sieve, chain
from neuro.events.formats import FORMATS, Damage, Format, Found, Piece
from neuro.events.info import info
from neuro.events.representations import REPRESENTATIONS
from neuro.events.segmentation import SEGMENTERS

MARK = b"MINE\n"


pytestmark = pytest.mark.usefixtures("registries")


def opened(source):
    data = source.all()[len(MARK) :]
    if data.size % 16:
        raise Damage(f"{data.size % 16} bytes left over", len(MARK) + data.size // 16 * 16)
    t, x, y, p = data.view("<i4").reshape(-1, 4).T
    return Found((34, 34), {}, (Piece(t.astype(np.int64), *(c.astype(np.uint16) for c in (x, y)), p.astype(np.uint8)),))


def write(parts, path):
    with path.open("wb") as file:
        file.write(MARK)
        for part in parts:
            file.write(np.stack([part.t, part.x, part.y, part.p], 1).astype("<i4").tobytes())


def mine(**changes):
    words = {"name": "mine", "title": "Mine", "suffixes": (".mine",), "knows": lambda head: head.startswith(MARK)}
    return Format(**{**words, "open": opened, "write": write, **changes})


@pytest.fixture
def events():
    return Events([5, 6, 7], [0, 1, 2], [2, 1, 0], [0, 1, 0], (34, 34))


def test_a_format_is_known_by_name_ending_and_content(tmp_path, events):
    made = mine()
    assert neuro.register(made) is made
    save(events, tmp_path / "a.mine")
    save(events, tmp_path / "b", format="mine")
    save(events, tmp_path / "c.bin", format="mine")
    for file in ("a.mine", "b", "c.bin"):
        assert load(tmp_path / file) == events, file
        assert info(tmp_path / file).format == "mine"
    assert next(stream(tmp_path / "b", format="mine")) == events
    assert load((tmp_path / "b").read_bytes()).metadata["format"] == "mine"


def test_damage_in_a_third_party_format_is_reported_like_any(tmp_path):
    neuro.register(mine())
    (tmp_path / "a.mine").write_bytes(MARK + b"\0" * 17)
    assert refusal(load, tmp_path / "a.mine") == f"{tmp_path}/a.mine: byte 21: 1 bytes left over"


def test_a_text_with_a_signature_is_not_taken_for_a_table(tmp_path):
    text = b"# mine\n1,2,3,1\n"
    (tmp_path / "a.csv").write_bytes(text)
    assert load(tmp_path / "a.csv").metadata["format"] == "csv"
    one = Piece(np.array([9]), np.array([2], np.uint16), np.array([3], np.uint16), np.array([1], np.uint8))
    signed = {"knows": lambda head: head.startswith(b"# mine"), "open": lambda source: Found((34, 34), {}, (one,))}
    neuro.register(mine(**signed))
    assert load(tmp_path / "a.csv").t.tolist() == [9]


def test_an_ending_without_a_signature_stays_ours(tmp_path, events):
    neuro.register(mine(suffixes=(".bin",), knows=lambda head: False))
    save(events, tmp_path / "a.bin")
    assert load(tmp_path / "a.bin").metadata["format"] == "nmnist"


def test_a_data_set_holds_files_of_a_third_party_format(tmp_path, events):
    neuro.register(mine())
    for name in ("a", "b"):
        (tmp_path / "set" / name).mkdir(parents=True)
        save(events, tmp_path / "set" / name / "1.mine")
    data = Dataset(tmp_path / "set")
    assert (len(data), data.classes) == (2, ("a", "b"))


@pytest.mark.parametrize(("changes", "expected"), [
    ({"name": "hdf5:mine"}, "'hdf5:mine': expected a name without ':', '/' and spaces"),
    ({"suffixes": ".a"}, "'mine': suffixes = '.a': expected endings with a dot, such as ('.mine',)"),
    ({"suffixes": ("a",)}, "'mine': suffixes = ('a',): expected endings with a dot, such as ('.mine',)"),
    ({"suffixes": (".A",)}, "'mine': suffixes = ('.A',): expected lower case, which matches names in any case"),
    ({"open": None}, "'mine': expected two functions, knows(head) and open(source)")
])  # fmt: skip
def test_a_format_that_cannot_be_used(changes, expected):
    neuro.register(mine(**changes))
    assert refusal(load, b"nothing") == f"event format {expected}"


def test_a_format_is_registered_once():
    neuro.register(mine())
    assert "'mine' is registered twice\n  hint: give it another name" in refusal(neuro.register, mine())
    assert "event format 'csv' is registered twice" in refusal(neuro.register, mine(name="csv"))


def test_a_format_of_an_installed_package(tmp_path, monkeypatch, events):
    (tmp_path / "their_format.py").write_text(
        "import numpy as np\n"
        "from neuro.events.formats import Format, Found\n"
        "THEIRS = Format('theirs', 'Theirs', ('.their',), lambda head: head[:3] == b'THE', lambda s: Found((7, 7)))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "their_format", raising=False)
    entries = EntryPoints([EntryPoint("theirs", "their_format:THEIRS", "neuro.formats")])
    registry.installed.cache_clear()
    monkeypatch.setattr(registry, "_installed", lambda: entries)
    assert FORMATS["csv"].name == "csv"
    assert "their_format" not in sys.modules
    assert (load(b"THE").sensor_size, [*FORMATS][-1]) == ((7, 7), "theirs")
    registry.installed.cache_clear()


def test_entries_are_looked_up_only_for_what_is_not_ours(tmp_path, monkeypatch, events):
    def scan():
        raise AssertionError("scanned")

    registry.installed.cache_clear()
    monkeypatch.setattr(registry, "_installed", scan)
    save(events, tmp_path / "a.npz")
    assert (load(tmp_path / "a.npz"), load(tmp_path / "a.npz", format="npz")) == (events, events)
    assert len(FILTERS["crop"]((34, 34))(events)) == 3


@dataclass(frozen=True, eq=False)
class EveryNth(Sieve):
    """Let every n-th event pass."""

    word = "every"
    n: int = 2

    def _check(self):
        self._expect(self.n >= 1, "n", self.n, "at least 1")

    def _fresh(self):
        return (np.zeros(1, np.int64),)

    def _keep(self, events, keep):
        (seen,) = self._state
        keep[:] = (seen[0] + np.arange(len(events))) % self.n == 0
        seen[0] += len(events)


def test_a_filter_is_known_by_name(events):
    assert neuro.register(EveryNth) is EveryNth
    assert FILTERS["every"] is EveryNth
    assert chain(Crop((34, 34)), FILTERS["every"]((34, 34), n=2)).apply(events).t.tolist() == [5, 7]


def test_a_filter_without_a_word_is_called_like_its_class():
    @neuro.register
    @dataclass(frozen=True, eq=False)
    class Narrow(Crop):
        """A crop of another kind."""

    assert FILTERS["Narrow"] is Narrow


def test_filters_that_cannot_be_made():
    @neuro.register
    @dataclass(frozen=True, eq=False)
    class Idle(Filter):
        pass

    assert refusal(lambda: FILTERS["Idle"]) == "filter 'Idle' has no method '_part'"

    @neuro.register
    class Bare(EveryNth):
        m: int = 3

    assert (
        refusal(lambda: FILTERS["Bare"])
        == "filter 'Bare': 'm' is no parameter: expected @dataclass(frozen=True, eq=False) above the class"
    )


@pytest.mark.parametrize(
    ("kind", "table"),
    [("segmenter", SEGMENTERS), ("representation", REPRESENTATIONS), ("code", CODES), ("rate code", RATE_CODES)],
)
def test_functions_say_what_they_are(kind, table):
    @neuro.register(kind=kind)
    def mine(values):
        return values

    assert table["mine"] is mine
    assert [*table][-1] == "mine"


def test_a_kind_is_known_before_its_room_is_entered(tmp_path):
    """`import neuro` alone does not import events; what is registered there is a segmenter all the same."""
    import subprocess

    code = (
        "import neuro\n"
        "@neuro.register(kind='segmenter')\n"
        "def mine(t): return t\n"
        "print('mine' in neuro.events.segmentation.SEGMENTERS)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("True\n", "")


KINDS = (
    "backend, chip, code, distribution, event format, filter, model, rate code, representation, rule, segmenter, "
    "synapse"
)


def test_what_is_of_no_kind_is_refused():
    def mine(t):
        return t

    with pytest.raises(neuro.ModelError) as caught:
        neuro.register(mine)
    told = str(caught.value).partition("expected one of these: ")[2].partition("\n")[0].split(", ")
    assert told == sorted(told)
    assert set(KINDS.split(", ")) <= set(told), "apps that were imported have kinds of their own"
    assert str(caught.value).endswith("\n  hint: write neuro.register(kind=...) above a function")
    assert "neuro.register: found 3: expected a segmenter" in refusal(neuro.register, 3, kind="segmenter")
    with pytest.raises(neuro.ModelError, match=r"neuro\.register: kind = 'segmentr': expected one of these: backend, "):
        neuro.register(mine, kind="segmentr")


def changed(source, **arrays):
    return Found((34, 34), {}, (dataclasses.replace(opened(source).parts[0], **arrays),))


def failing(source):
    raise ValueError("buffer is too small")


@pytest.mark.parametrize("case", ["p", "x", "fails"])
def test_a_format_that_gives_no_events_is_told_with_the_file(messages, tmp_path, events, case):
    odd = SimpleNamespace(sensor_size=(34, 34), metadata={}, pieces=failing)
    arrays = {"p": {"p": np.zeros(2, np.uint8)}, "x": {"x": np.zeros(3)}}.get(case)
    neuro.register(mine(open=partial(changed, **arrays) if arrays else lambda source: odd))
    save(events, tmp_path / "a.mine")
    messages({case: refusal(load, tmp_path / "a.mine").replace(f"{tmp_path}/", "")})


def test_a_parameter_of_a_filter_is_of_its_kind():
    @dataclass(frozen=True, eq=False)
    class Only(Sieve):
        n: int

        def _keep(self, events, keep):
            keep[:] = events.p == self.n

    assert "Only: n = 'hello': expected a whole number" in refusal(Only, (34, 34), "hello")
