"""Scenes as files, and linkages by their lengths."""

SCHEMA = 1
"""The version of the format of scene files."""
DEEPEST = 20
"""How many tables and lists may stand in each other in a scene file; a scene needs seven."""
