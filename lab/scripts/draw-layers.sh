#!/usr/bin/env bash
# Draws the pictures of synthetic layers in docs/http.md: docs/layer-*.png.
#
#     lab/scripts/draw-layers.sh VOLUME MASK
#
# VOLUME and MASK are Colin27 (scripts/head.sh finds or fetches ch2.nii.gz) and a mask of its brain. PYTHON is a Python with
# numpy, scipy and nibabel.
set -euo pipefail
[ $# = 2 ] || { echo "usage: $0 VOLUME MASK" >&2; exit 2; }
volume=$(realpath "$1") mask=$(realpath "$2")
cd "$(dirname "$0")/../.."
cargo build --bin isocortex
folder=$(mktemp -d)
server=
trap '[ -z "$server" ] || kill "$server"; rm -rf "$folder"' EXIT
"${PYTHON:-python3}" scripts/example-layers.py "$volume" "$mask" "$folder"
target/debug/isocortex serve --create --data "$folder/data" --listen 127.0.0.1:0 >"$folder/server.log" 2>&1 &
server=$!
until address=$(grep -om1 'http://127[^ ]*' "$folder/server.log"); do sleep 0.2; done
case=$address/v1/cases/$(curl -fsS -F "volume=@$volume" -F "mask=@$mask" "$address/v1/cases" | jq -r .id)
until [ "$(curl -fsS "$case" | jq -r .state)" = ready ]; do sleep 0.5; done

# A file and its parameters; waits until the layer is ready.
layer() {
    local id
    id=$(curl -fsS "$case/layers" -F "volume=@$folder/$1.nii.gz" -F "parameters=$2" "${@:3}" | jq -r .id)
    until [ "$(curl -fsS "$case/layers/$id" | jq -r .state)" = ready ]; do sleep 0.5; done
}
layer flair '{"name": "FLAIR"}'
layer pet '{"name": "PET", "kind": "pet", "unit": "SUV"}'
layer zmap '{"name": "z map", "kind": "map", "unit": "z"}'
layer regions '{"name": "regions", "kind": "labels"}' -F "labels=@$folder/regions.txt"
layer prediction '{"name": "MELD", "kind": "labels"}'

picture() {
    curl -fsS -o "docs/layer-$1.png" "$case/$2&annotate=true&width=320&height=320"
}
picture flair 'render?depth_mm=14&view=left&layer=FLAIR'
picture pet 'render?depth_mm=14&view=left&overlay=PET'
picture zmap 'render?depth_mm=14&view=left&overlay=z%20map&overlay_threshold=2.5'
picture regions 'render?depth_mm=14&view=left&overlay=regions'
picture meld 'render?depth_mm=14&view=left&overlay=MELD'
picture slice 'slices/axial?position_mm=32&depth_mm=14&layer=FLAIR&overlay=MELD'
picture edges 'slices/axial?position_mm=32&overlay=FLAIR&edges=true'
