"""The version of whiptool."""

__version__ = "0.2.0"
