"""What every layer stands on, and nothing of networks: errors, quantities, checks, files, keyed random numbers."""
