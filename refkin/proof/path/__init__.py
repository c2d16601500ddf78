"""Proofs between times: a branch never changes."""
