"""The version of the package, stated once: the build, the command line and every saved run read it here."""

__version__ = "0.2.0"
