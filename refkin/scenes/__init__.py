"""Scenes as files, and linkages by their lengths."""

SCHEMA = 1
"""The version of the format of scene files."""
