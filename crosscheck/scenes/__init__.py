"""Scenes: drawn by the number of a night, and fixed ones: hard cases, features, questions of conformance, workloads."""
