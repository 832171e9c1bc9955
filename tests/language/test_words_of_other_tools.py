"""Words of NEST, Brian2, PyNN, snnTorch, Norse, BindsNET and Lava are answered with ours."""

from __future__ import annotations

import neuro
from beside import beside
from refused import error_of

(NET,) = beside(__file__, "NET")


def test_the_hint_is_our_word(folder, messages):
    def of(said):
        part, _, word = said.partition(": ")
        words = {"model": "iaf_psc_exp", "rule": "all_to_all", "synapse": "static", part: word}
        (folder / "net.yaml").write_text(NET.format(**words))
        return error_of(neuro.load, "net.yaml").hint

    messages.of(of)
