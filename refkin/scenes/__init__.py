"""Scenes as files, and linkages by their lengths."""
