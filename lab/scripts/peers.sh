#!/usr/bin/env bash
# Measures other programs on the same head, step by step and in alternation with ours, and prints the ratios. They are Python
# packages, fetched from PyPI into target/peers. Arguments go to lab/peers/run.py: --rounds N, --steps a,b.
# The head is ISOCORTEX_DEMO_VOLUME with ISOCORTEX_DEMO_MASK, otherwise Colin27.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/../../scripts/lib.sh"

readonly PACKAGES=(numpy scipy nibabel SimpleITK edt dijkstra3d scikit-image vtk pillow pyfqmr)

need_rust
have python3 || die "python3 is missing: the other programs are Python packages."
peers=$(target_dir)/peers
if [ ! -e "$peers/complete" ]; then
  say "fetching ${PACKAGES[*]} into $peers"
  python3 -m venv "$peers" || die "cannot create a virtual environment; install python3-venv."
  "$peers/bin/pip" install -q --disable-pip-version-check "${PACKAGES[@]}"
  touch "$peers/complete"
fi
volume=${ISOCORTEX_DEMO_VOLUME:-}
mask=${ISOCORTEX_DEMO_MASK:-}
if [ -z "$volume" ]; then
  folder=$(scripts/head.sh | tail -n 1) || die "no head is available; set ISOCORTEX_DEMO_VOLUME and ISOCORTEX_DEMO_MASK"
  volume=$folder/ch2.nii.gz mask=$folder/ch2bet.nii.gz
fi
[ -n "$mask" ] || die "ISOCORTEX_DEMO_MASK must name the mask of ISOCORTEX_DEMO_VOLUME."
lab_cargo build --locked -q --release
exec "$peers/bin/python" lab/peers/run.py --isocortex-bench "$(target_dir)/release/isocortex-bench" \
  --volume "$volume" --mask "$mask" "$@"
