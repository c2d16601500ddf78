"""MuJoCo: its model of a scene, its constraint rows, its time stepping."""
