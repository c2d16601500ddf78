"""What `refkin.solve` does beyond the plain analysis: starts, the sweep that keeps its branch, following."""
