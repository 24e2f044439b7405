"""The commands of `symmb`, such as bounding the outputs of a scene, simulating a scene, or exporting a scene as C.

A scene from a Python file has its own output times. `urdf_scene` chooses the output times for a URDF file.
"""
