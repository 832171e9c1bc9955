"""Elements, style and drawings of HTML pages."""
