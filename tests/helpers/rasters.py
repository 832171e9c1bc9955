"""Pages as readers see them, and their rasters as the script of a page reads them."""

import base64
import json
from collections import Counter
from html.parser import HTMLParser

VOID = {"meta", "link"}


class Page(HTMLParser):
    """A page whose elements close in order: attributes, words, rows of tables, and the data of rasters."""

    def __init__(self, text):
        super().__init__()
        self.open, self.attributes, self.words, self.rows, self.data = [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, name, attributes):
        self.attributes += [(name, *pair) for pair in attributes]
        if name not in VOID:
            self.open.append("json" if ("type", "application/json") in attributes else name)
        if name == "tr":
            self.rows.append([])
        if name == "td":
            self.rows[-1].append("")

    def handle_endtag(self, name):
        assert self.open.pop() in (name, "json")

    def handle_data(self, text):
        inside = self.open[-1] if self.open else ""
        if inside == "json":
            self.data.append(json.loads(text))
        elif inside not in ("script", "style"):
            self.words.append(text)
        if inside == "td":
            self.rows[-1][-1] += text

    def row(self, *begin):
        """The only row of a table that begins so."""
        [found] = [row for row in self.rows if tuple(row[: len(begin)]) == begin]
        return found[len(begin) :]

    @property
    def links(self):
        return [value for _, name, value in self.attributes if name in ("src", "href", "srcset", "action", "data")]

    @property
    def dots(self):
        """How many spikes of each kind are drawn."""
        found = Counter()
        for data in self.data:
            for strip in data["strips"]:
                found.update({kind: len(unpacked(keys)) for kind, keys in strip["kinds"].items()})
        return found

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def unpacked(text):
    """Keys of spikes as the page's script reads them."""
    keys, key, gap, place = [], 0, 0, 1
    for byte in base64.b64decode(text):
        gap += (byte & 127) * place
        place *= 128
        if byte < 128:
            key += gap
            keys.append(key)
            gap, place = 0, 1
    return keys
