"""Training by gradients: from recordings to a network that chips run, with its accuracy and its joules."""
