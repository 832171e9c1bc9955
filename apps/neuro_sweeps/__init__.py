"""Many runs of one thing over a space of values, each kept in a folder of its own."""
