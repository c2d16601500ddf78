"""Balls, exact laws, derivatives of rows: the numbers that proofs are made of."""
