"""Scenes that are fixed: hard cases, priced classes, workloads of the benchmark."""
