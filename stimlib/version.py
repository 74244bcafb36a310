"""The release, which every file that is written tells."""

__version__ = "0.1.0"
