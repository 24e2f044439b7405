"""What a user declares: parameters, bodies, points, constraints, forces. Frozen values; nothing is derived here."""
