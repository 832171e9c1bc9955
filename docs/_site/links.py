"""Links that lead out of the folder of pages: to their place on the site, so that the pages need not know it."""

from __future__ import annotations

from pathlib import PurePosixPath

from docutils import nodes
from gallery import examples
from sphinx import addnodes
from sphinx.application import Sphinx

PAGES = {
    "CHANGELOG": "project/changes",
    "CONTRIBUTING": "project/contributing",
    "examples": "gallery/index",
    "LICENSE": "project/license",
    "SECURITY": "project/security",
    **{name: f"gallery/{part}/{name}" for part, name, _ in examples()},
}
"""The pages that show a file or folder of the repository outside of `docs`, by its name."""


def on_the_site(app: Sphinx, doctree: nodes.document) -> None:
    """Make a link to a file that the site shows as a page a link to this page."""
    for node in [*doctree.findall(addnodes.download_reference), *doctree.findall(addnodes.pending_xref)]:
        target = PurePosixPath(node["reftarget"])
        page = (
            PAGES.get(target.stem)
            if target.stem.isupper() or target.suffix == ".py" or target.name == "examples"
            else None
        )
        if page is not None and node.get("refdomain") != "py" and not app.env.docname.startswith("gallery/"):
            words = {"refdomain": "std", "reftype": "doc", "reftarget": f"/{page}", "refexplicit": True}
            node.replace_self(addnodes.pending_xref("", *node.children, refdoc=app.env.docname, **words))


def setup(app: Sphinx) -> dict[str, object]:
    """Called by Sphinx."""
    app.connect("doctree-read", on_the_site)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
