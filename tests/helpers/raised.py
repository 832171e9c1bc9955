"""What tests of mistakes share."""

from collections.abc import Callable
from typing import Any

import pytest

from neuro import ModelError


def refusal(call: Callable[[], Any]) -> ModelError:
    """The error that a call ends with."""
    with pytest.raises(ModelError) as error:
        call()
    return error.value


def refused(call: Callable[[], Any]) -> str:
    """What a user reads of that error: its place, message and hint."""
    return str(refusal(call))
