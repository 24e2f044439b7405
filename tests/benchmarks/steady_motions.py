"""Linearisations of random steady motions against closed forms: python tests/benchmarks/steady_motions.py FIRST LAST.

It prints, for seeds FIRST to LAST - 1 of each kind of motion, how many have all eigenvalues of the closed form to 1e-6,
how many are wrong without a doubt, and how many are right but doubted. Seeds 1 and 2 are those of the tests.
"""

import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

import symmb as mb

sys.path.insert(0, str(Path(__file__).parent.parent))
from steady_scenes import random_motions


def main(first: int, last: int) -> None:
    warnings.simplefilter("ignore")
    counts: dict[str, Counter[str]] = {}
    for seed in range(first, last):
        for motion in random_motions(seed):
            lin = mb.linearize(motion.scene)
            off = [np.abs(lin.eigenvalues - value).min() / abs(value) for value in motion.eigenvalues]
            right = motion.steady and max(off) < 1e-6
            word = "right" if right else "told" if lin.doubts else "WRONG IN SILENCE"
            word = "NEEDLESS DOUBT" if motion.steady and lin.doubts else word
            counts.setdefault(motion.name, Counter())[word] += 1
            if word.isupper():
                print(f"seed {seed}: {motion.name}: {word}, {max(off):.1e}", flush=True)
    for name, count in counts.items():
        print(f"{name:20} {', '.join(f'{word} {n}' for word, n in count.items())}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
