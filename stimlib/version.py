"""The release, which is in every file that is written."""

__version__ = "0.2.0"
