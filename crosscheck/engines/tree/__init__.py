"""Joint trees with loops to close: what MuJoCo and Pinocchio share, in numbers only."""
