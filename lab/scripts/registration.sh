#!/usr/bin/env bash
# Measures the error of registrations of synthetic pairs, ours and SimpleITK's on the same pairs. Arguments are heads as
# VOLUME:MASK; without any, the heads below ISOCORTEX_TEST_DATA. SimpleITK is fetched from PyPI into target/peers-registration.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/../../scripts/lib.sh"

need_rust
have python3 || die "python3 is missing: the other program is a Python package."
heads=("$@")
if [ ${#heads[@]} = 0 ]; then
  data=${ISOCORTEX_TEST_DATA:-}
  [ -n "$data" ] || die "name heads as VOLUME:MASK, or set ISOCORTEX_TEST_DATA to the folder of the test heads"
  for volume in "$data"/*/ch2.nii.gz "$data"/*/t1.nii.gz; do
    mask=${volume%/*}/mask_dura.nii.gz
    if [ -f "$volume" ] && [ -f "$mask" ]; then heads+=("$volume:$mask"); fi
  done
fi
peers=$(target_dir)/peers-registration
if [ ! -e "$peers/complete" ]; then
  say "fetching numpy and SimpleITK into $peers"
  python3 -m venv "$peers" || die "no virtual environment can be made; Debian has it in python3-venv."
  "$peers/bin/pip" install -q --disable-pip-version-check numpy SimpleITK
  touch "$peers/complete"
fi
pairs=$(mktemp -d)
trap 'rm -rf "$pairs"' EXIT
lab_cargo run --locked -q --release --example registration-errors -- --pairs "$pairs" "${heads[@]}"
"$peers/bin/python" lab/peers/registration.py "$pairs"
