"""Names of settings for methods of one's own, and sources that several values share."""

from neuro.apps import Part as Part, Settings as Settings, part as part, setting as setting

SPLITS = "chosen on splits of N-MNIST's training recordings, which its accuracies are of, too"
"""Source of a value that was chosen by what was reported afterwards, not on recordings apart."""
