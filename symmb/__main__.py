"""The program `symmb`, as `python -m symmb` runs it."""

from runpy import run_module

run_module("symmb.cli", run_name="__main__")
