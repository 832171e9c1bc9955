"""What Python holds and calls between steps."""
