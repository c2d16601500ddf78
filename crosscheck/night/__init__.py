"""A night: its plan and journal, golden set, disagreements, history, what is measured after its scenes; the hunt."""
