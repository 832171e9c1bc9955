"""What pages are made of: elements, one style, and drawings that several pages have."""
