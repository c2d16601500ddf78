"""exudyn: its model of a scene, its rows, its solvers."""
