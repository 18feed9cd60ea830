"""The version, which everything that rauca writes names."""

__version__ = "0.1.0"
