"""C from CasADi instruction lists: emitted, built, cached and loaded; step loops that run many samples side by side."""
