"""What was found, told: lines of a terminal, tables, pictures and pages."""
