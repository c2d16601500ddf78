"""Scenes as files, and linkages by their lengths."""

SCHEMA = 1
"""The version of the format of scene files."""
MOST_TIMES = 10_000_000
"""How many times a scene has at most that says them by a number."""
DEEPEST = 20
"""How many tables and lists may stand in each other in a scene file; a scene needs seven."""
