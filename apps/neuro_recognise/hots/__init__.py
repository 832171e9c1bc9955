"""HOTS: layers of time surfaces that learn what surfaces there are."""
