"""Output of results: lines of a terminal, tables, pictures and pages."""
