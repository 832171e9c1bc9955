"""What the compiled backends share: how they compile, and keyed random numbers."""
