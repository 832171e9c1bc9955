"""Recognition of objects with event cameras by published methods."""
