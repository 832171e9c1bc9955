"""Networks that recognise, asked about recordings of event cameras: decisions, accuracy, joules, pictures."""
