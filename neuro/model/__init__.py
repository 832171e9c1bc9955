"""What a description is: networks, models of neurons and synapses, rules, distributions, and their YAML."""
