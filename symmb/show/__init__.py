"""What leaves symmb for people and for other programs.

In:   scenes, runs, bounds and comparisons.
Out:  pages, films and pictures of mechanisms, reports, functional mock-up units, and the command line.

drawing    the mechanism: shapes in numbers, then a page, a still or a film
exchange   FMUs of scenes
report     one file that can be handed on
cli        the command `symmb`, a client of the public names
"""
