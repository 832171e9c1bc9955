"""The best point of a space looked for: Optuna asks, runs are those of sweeps."""
