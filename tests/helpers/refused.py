"""What is said of a call that is refused."""

from collections.abc import Callable

import pytest

from neuro import ModelError


def error_of(call: Callable[..., object], *args: object, **words: object) -> ModelError:
    """The error that a call ends with."""
    with pytest.raises(ModelError) as error:
        call(*args, **words)
    return error.value


def refused(call: Callable[..., object], *args: object, **words: object) -> str:
    """What a user reads of that error: its place, message and hint."""
    return str(error_of(call, *args, **words))


def without_place(call: Callable[..., object], *args: object, **words: object) -> str:
    """The message of the error of a call, without the place in a test."""
    with pytest.raises((ModelError, TypeError, AttributeError)) as error:
        call(*args, **words)
    place = str(getattr(error.value, "where", ""))
    return str(error.value).removeprefix(f"{place}: ") if ".py" in place else str(error.value)
