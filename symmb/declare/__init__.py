"""Declarations of users: frozen values with expressions. This package does not contain equations of motion.

In:   numbers, expressions of CasADi or SymPy, and files of robots, meshes and finite elements.
Out:  parameters, bodies, joints, forces, contacts and states, each with its own part of the equations.

symbolic     expressions: conversion from SymPy, switches, ranges, factorizations, evaluation of many samples
structures   finite elements, beams, and the modes of a flexible body
mechanics    bodies, joints, forces, contacts, outputs; `robots` reads URDF and MJCF

Each element returns its own contribution: terms of M, forces, or rows of constraints. No element knows the system.
"""
