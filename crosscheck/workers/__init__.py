"""Child processes and clusters that do the work, and what becomes of those that crash or hang."""
