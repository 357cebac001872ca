"""The simulator: world, drones, cameras and noise. An independent oracle for what it tests."""
