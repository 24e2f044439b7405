"""Implicit step formulas as symbolic residuals: data for one driver, which lets CasADi derive their Newton matrix."""
