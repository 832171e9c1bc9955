"""What users hold: the simulation, its trials, records and settings."""
