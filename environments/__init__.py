"""The world: robots, surfaces, contact, trajectories, sensors. It knows nothing of controllers, screens or threads."""
