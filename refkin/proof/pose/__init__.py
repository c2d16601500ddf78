"""Proofs of one pose: certificate, Krawczyk test, singularity."""
