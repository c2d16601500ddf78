"""Pinocchio: its model of a scene, its constraint rows, its closed-chain example."""
