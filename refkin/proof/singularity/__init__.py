"""What a singular pose is."""
