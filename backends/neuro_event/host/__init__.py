"""The Python side of the engine, which acts between steps."""
