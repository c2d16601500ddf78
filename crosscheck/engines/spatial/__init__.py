"""What the adapters share in space: a scene's joints in numbers, rotations, the joint tree, and its equations."""
