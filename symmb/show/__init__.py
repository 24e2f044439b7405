"""Output for people and for other programs.

In:   scenes, runs, bounds and comparisons.
Out:  pages, films and pictures of mechanisms, reports, functional mock-up units, and the command line.

drawing    pages, stills and films of mechanisms
exchange   FMUs (functional mock-up units) of scenes
live       pages that run a scene and compute bounds while a reader changes parameters
report     one file with a result, for other readers
cli        the command `symmb`, which uses only public names
"""
