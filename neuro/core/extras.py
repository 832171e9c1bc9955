"""Optional modules: the command that installs a missing package, and import on first use."""

from __future__ import annotations

import shlex
from importlib import import_module
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.lazy import DISTRIBUTION, missing


def install(extra: str) -> str:
    """Return the pip command that installs an extra of this package, for hints.

    Args:
        extra: name of the extra in `pyproject.toml`, e.g. "torch".

    Source: direct_url.json of the Python Packaging User Guide, "Recording the Direct URL Origin".
    """
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    origin = _origin()
    if origin is None:
        return f"pip install '{DISTRIBUTION}[{extra}]'"
    url = urlsplit(origin.get("url", ""))
    if url.scheme != "file":
        return f"pip install '.[{extra}]' in the folder of neuro's sources"
    option = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f"pip install {option}{shlex.quote(f'{url2pathname(url.path)}[{extra}]')}"


def needed(module: str, extra: str, message: str) -> Any:
    """Import a module of an optional package.

    Args:
        module: name of the module.
        extra: the extra of this package that installs the module.
        message: message of the error.

    Raises:
        ModelError: the module is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise ModelError(message, hint=install(extra)) from None


def app(module: str, subject: str) -> Any:
    """Import a module from a package of `apps`, which may be missing.

    Args:
        module: name of the module, e.g. "neuro_events.playing".
        subject: part that needs the module, for the message.

    Raises:
        ModelError: the package is not installed.
    """
    package = module.partition(".")[0]
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        raise ModelError(f"{subject} {missing(package)}") from None


class LazyModule:
    """A module that is imported on first access to an attribute, e.g. a module of compiled kernels.

    Args:
        name: name of the module.

    Example:
        >>> json = LazyModule("json")
        >>> json.dumps([1])
        '[1]'
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        if name == "_module":  # called on first use only: the attribute then exists
            self._module = import_module(self._name)
            return self._module
        return getattr(self._module, name)


def _origin() -> dict[str, Any] | None:
    """Return pip's record of the source of this package: None for an index, {} if pip did not install the package."""
    import json
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        text = distribution(DISTRIBUTION).read_text("direct_url.json")
        return None if text is None else dict(json.loads(text))
    except PackageNotFoundError:
        return {}
