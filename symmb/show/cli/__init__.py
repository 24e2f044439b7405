"""The command line: commands that compare methods on a scene, simulate it, show its equations, or export it as C."""
