"""What every result can do: be saved as a file, and be drawn as a picture.

In:   numbers with names, units and times, from every other wing.
Out:  files that are written completely or not at all, and pictures.

files   JSON, NPZ, CSV and tables; one checked reader for all results
plot    pictures by Matplotlib
"""
