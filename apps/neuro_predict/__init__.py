"""Classes of event-camera recordings, decided by a network: decisions, accuracy, energy, pictures."""
