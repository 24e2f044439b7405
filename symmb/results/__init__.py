"""Common functions of all results: files and pictures.

In:   numbers with names, units and times, from all other packages.
Out:  files that are written completely or not at all, and pictures.

files   JSON, NPZ, CSV and tables; one reader for all results, which checks the contents
plot    pictures by Matplotlib
"""
