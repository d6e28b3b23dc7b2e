"""Surfaces Phi(x, t) = 0 with the coordinates (phi, psi_1, psi_2) around them, (30) and (31).

phi is penetration: positive inside the environment, so its gradient points into it. Each file is one surface, a row of
`table.SURFACES`: its fields in a scenario, its coordinates in its own frame with exact first and second derivatives,
and their inverse. It moves as one body; `table.surface_chart` adds the effect of the movement to every derivative.
"""
