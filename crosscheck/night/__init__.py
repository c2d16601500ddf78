"""A night: drawing scenes, journal of what happened, golden set, disagreements, history."""
