"""Results, models and pages made again from what they hold, and compared bit by bit."""
