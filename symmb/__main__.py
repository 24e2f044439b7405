"""The program `symmb`, as `python -m symmb` runs it."""

from runpy import run_module

run_module("symmb.show.cli", run_name="__main__")
