"""What is kept on disk: states, results, and plots of them."""
