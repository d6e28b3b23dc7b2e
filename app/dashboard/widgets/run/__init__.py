"""Widgets of the present run: playback, what stands beside the scene, what-if."""
