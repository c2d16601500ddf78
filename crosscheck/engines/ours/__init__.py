"""Producers of our own formulas: refkin by its settings, its fast path, SciPy, and C for the benchmark."""
