"""The version of feedplan, apart from the door that hands it on."""

__version__ = "0.1.0"
