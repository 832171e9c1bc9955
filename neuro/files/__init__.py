"""What is kept on disk: states and results, and the way to read both these and a simulation."""
