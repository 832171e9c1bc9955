"""Golden traces of other simulators beside ours."""
