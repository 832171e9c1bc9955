"""Classes and functions to define the settings of a custom method."""

from neuro.apps import Part as Part, Settings as Settings, part as part, setting as setting
