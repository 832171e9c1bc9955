"""What is said of a network that goes from or to PyNN, beside refusals."""


class ExchangeNote(UserWarning):
    """A network goes from or to another tool, but something of it is otherwise there."""
