"""A night: drawing scenes, journal of records, golden set, disagreements, history."""
