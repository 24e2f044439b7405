"""The command line: compare methods on a scene, simulate it, show its equations, export it as C."""
