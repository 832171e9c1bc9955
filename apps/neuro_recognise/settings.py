"""Names of settings for methods of one's own."""

from neuro.apps import Part as Part, Settings as Settings, part as part, setting as setting
