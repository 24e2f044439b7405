#!/usr/bin/env bash
# At -O1, gcc forms no fused products, although -ffp-contract=fast asks for them. They need -fexpensive-optimizations.
#
# Expected before the first run: -O1 and -O2 give the same bits for a * b + c, because the flag is the same, and clang
# fuses at both levels.
# Seen with gcc 12.2 on x86-64: one vfmadd at -O2, none at -O1, and one at -O1 with -fexpensive-optimizations. clang
# (in ziglang 0.13.0) has one at -O1 and at -O2. So results of a library that is compiled by gcc with -O1, for a
# faster build, differ in their last digits from those of -O2.
# gcc is that of the machine, such as gcc 12.2 of Debian 12; clang is pinned.
# The manual of gcc lists -ffp-contract without this condition, and describes -fexpensive-optimizations as a number of
# minor optimizations that are relatively expensive.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ "$(uname -m)" = x86_64 ] || { echo "needs an x86-64 processor"; exit 1; }
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet ziglang==0.13.0
gcc --version | head -n 1
"$work/venv/bin/python" -m ziglang cc --version | head -n 1
echo 'double fused(double a, double b, double c) { return a * b + c; }' >"$work/fused.c"
count() { # a compiler and its flags -> number of fused products
  "$@" -ffp-contract=fast -S "$work/fused.c" -o "$work/fused.s" 2>"$work/said"
  grep -c vfmadd "$work/fused.s" || true
}
clang=("$work/venv/bin/python" -m ziglang cc -target x86_64-linux-gnu -mcpu=x86_64_v3)
gcc=(gcc -mfma)
seen="gcc: $(count "${gcc[@]}" -O1) $(count "${gcc[@]}" -O1 -fexpensive-optimizations) $(count "${gcc[@]}" -O2)"
seen="$seen, clang: $(count "${clang[@]}" -O1) $(count "${clang[@]}" -O2)"
echo "fused products at -O1, at -O1 with -fexpensive-optimizations, and at -O2; clang at -O1 and -O2"
echo "expected  gcc: 1 1 1, clang: 1 1"
echo "seen      $seen"
[ "$seen" = "gcc: 0 1 1, clang: 1 1" ]
