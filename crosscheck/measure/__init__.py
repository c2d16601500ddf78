"""Loops over methods and scenes that write records: check, prices, effects, hard cases, benchmark."""
