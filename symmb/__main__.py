"""The program `symmb`, started by `python -m symmb`."""

from runpy import run_module

run_module("symmb.show.cli", run_name="__main__")
