"""Studies of a scene: comparison of bounding methods, and stability of solvers.

Both report errors against run time.
"""
