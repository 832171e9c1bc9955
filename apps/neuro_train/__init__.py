"""Training by gradients on recordings, with the accuracy and the joules of the trained network on chips."""
