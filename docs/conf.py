"""The site: `make docs` builds it from the pages of this folder, the docstrings and the examples."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_site"))

import gallery  # noqa: E402

from neuro import __version__  # noqa: E402

project = "neuro"
author = "The neuro authors"
copyright = f"2026, {author}"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docstrings",
    "gallery",
    "sphinx_gallery.gen_gallery",
    "links",
    "mathml",
]
root_doc = "index"
exclude_patterns = ["_site", "gallery/**/*.py", "gallery/**/*.ipynb"]
# ref.python: a name in backticks, such as `steps`, may be that of members of several classes; the first is linked.
suppress_warnings = ["config.cache", "ref.python"]
nitpicky = True

myst_enable_extensions = ["colon_fence", "dollarmath"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_output_stderr = "remove"
html_math_renderer = "mathml"
myst_heading_anchors = 4

sphinx_gallery_conf = {
    "examples_dirs": "../build/examples",
    "gallery_dirs": "gallery",
    "filename_pattern": rf"/({'|'.join(name for _, name, words in gallery.examples() if 'stored' not in words)})\.py$",
    "subsection_order": [f"../build/examples/{part}" for part in gallery.PARTS],
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("gallery.written_pictures",),
    "abort_on_example_error": True,
    "capture_repr": (),
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "plot_gallery": "True",
    "thumbnail_size": (480, 300),
    "nested_sections": True,
}

autodoc_member_order = "groupwise"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_use_ivar = True
napoleon_custom_sections = [("Class attributes", "Attributes")]
default_role = "py:obj"
nitpick_ignore_regex = [("py:.*", ".*")]

smartquotes = False

html_theme = "pydata_sphinx_theme"
html_title = f"neuro {release}"
# The site has the fonts and colours of the pages that commands write.
html_static_path = ["_site/static", "../neuro/core/tokens.css"]
html_css_files = ["tokens.css", "site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "neuro"},
    "navbar_align": "left",
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_context = {"default_mode": "auto"}
