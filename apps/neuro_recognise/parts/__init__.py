"""Parts of methods by name: what recordings become on their way to an answer."""
