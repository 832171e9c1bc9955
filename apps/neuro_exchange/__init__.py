"""Networks of other tools: read into a `Network`, and written from one."""
