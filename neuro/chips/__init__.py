"""What is known of chips: limits, costs, and how a float program becomes one of integers on cores."""
