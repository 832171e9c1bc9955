"""What is said of a call that is refused."""

from collections.abc import Callable

import pytest

from neuro import ModelError


def refused(call: Callable[..., object], *args: object, **words: object) -> str:
    """The whole message, with its hint."""
    with pytest.raises(ModelError) as error:
        call(*args, **words)
    return str(error.value)
