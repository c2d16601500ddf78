"""Compares exudyn, Pinocchio and MuJoCo with the reference: how many digits each can be trusted for."""
