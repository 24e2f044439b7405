"""The commands of `symmb`, such as bounding the outputs of a scene, simulating a scene, or exporting a scene as C."""
