"""Widgets of the target model (8): its equation, checks, poles and impedance."""
