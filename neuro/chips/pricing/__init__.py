"""What a run takes on a chip: counts times figures with sources."""
