#!/usr/bin/env bash
# Draws the pictures of a synthetic lesion in the README: docs/lesion-*.png.
#
#     scripts/draw-lesion.sh VOLUME MASK
#
# VOLUME and MASK are Colin27 (https://packages.debian.org/mricron-data, ch2.nii.gz) and a mask of its brain. The lesion is
# the sixth one of the study with blurs of 1.5 mm and a radius of 6 mm: left frontal, 17 mm deep.
set -euo pipefail
[ $# = 2 ] || { echo "usage: $0 VOLUME MASK" >&2; exit 2; }
volume=$(realpath "$1") mask=$(realpath "$2")
cd "$(dirname "$0")/.."
cargo build --workspace --bins
folder=$(mktemp -d)
server=
trap '[ -z "$server" ] || kill "$server"; rm -rf "$folder"' EXIT
target/debug/isocortex-bench study --head "colin27=$volume,$mask" --radius-mm 6 --blur-mm 1.5 --lesions 6 \
    --results "$folder/results" --write "$folder"
place=$(jq -c '.trials[5].position_in_patient | map(round)' "$folder/results/colin27.json")
echo "The lesion is at $place (LPS mm)."
target/debug/isocortex serve --data "$folder/data" --listen 127.0.0.1:0 >"$folder/server.log" 2>&1 &
server=$!
until address=$(grep -om1 'http://127[^ ]*' "$folder/server.log"); do sleep 0.2; done
case=$(curl -fsS -F "volume=@$folder/colin27-5.nii.gz" -F "mask=@$mask" "$address/v1/cases" | jq -r .id)
until [ "$(curl -fsS "$address/v1/cases/$case" | jq -r '.maps.state')" = ready ]; do sleep 0.5; done
picture() {
    curl -fsS -o "docs/lesion-$1.png" "$address/v1/cases/$case/$2&width=320&height=320"
}
picture peel 'render?depth_mm=16.8&view=anterior&zoom=1.7'
picture blur 'render?depth_mm=16.8&view=anterior&zoom=1.7&overlay=blur'
for slice in sagittal,0 coronal,1 axial,2; do
    picture "${slice%,*}" "slices/${slice%,*}?position_mm=$(jq ".[${slice#*,}]" <<<"$place")"
done
