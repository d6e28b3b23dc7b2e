"""Environment of the controller: robots, surfaces, contact, trajectories, sensors. It knows nothing of controllers,
screens or threads."""
