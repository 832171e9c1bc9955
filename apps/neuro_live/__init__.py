"""A browser page that shows and controls a running network; needs the extra `live`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.apps import public_names

if TYPE_CHECKING:
    from neuro_live.page import Page as Page


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
