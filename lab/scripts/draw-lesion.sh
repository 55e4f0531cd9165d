#!/usr/bin/env bash
# Draws the pictures of a synthetic lesion in the README: docs/lesion-*.png.
#
#     lab/scripts/draw-lesion.sh VOLUME MASK
#
# VOLUME and MASK are Colin27 (https://packages.debian.org/mricron-data, ch2.nii.gz) and a mask of its brain. The lesion is
# the study's first blur that is right frontal and 12 to 16 mm deep. Needs jq and Pillow.
set -euo pipefail
[ $# = 2 ] || { echo "usage: $0 VOLUME MASK" >&2; exit 2; }
volume=$(realpath "$1") mask=$(realpath "$2")
cd "$(dirname "$0")/../.."
cargo build --bin isocortex
folder=$(mktemp -d)
server=
trap '[ -z "$server" ] || kill "$server"; rm -rf "$folder"' EXIT
CARGO_TARGET_DIR=target cargo run --manifest-path lab/Cargo.toml -- study --head "colin27=$volume,$mask" --shams 0 \
    --results "$folder/results" --write "$folder/heads" >/dev/null
results=$folder/results/displaced/colin27.json
number=$(jq '[.trials[] | .sign == "blur" and .area == "frontal" and .position_in_patient[0] < 0
    and .depth_mm >= 12 and .depth_mm <= 16] | index(true)' "$results")
place=$(jq -c ".trials[$number].position_in_patient | map(round)" "$results")
echo "The lesion is at $place (LPS mm)."
target/debug/isocortex serve --create --data "$folder/data" --listen 127.0.0.1:0 >"$folder/server.log" 2>&1 &
server=$!
until address=$(grep -om1 'http://127[^ ]*' "$folder/server.log"); do sleep 0.2; done
case=$(curl -fsS -F "volume=@$folder/heads/displaced/colin27-$number.nii.gz" -F "mask=@$mask" "$address/v1/cases" | jq -r .id)
until [ "$(curl -fsS "$address/v1/cases/$case" | jq -r '.maps.state')" = ready ]; do sleep 0.5; done
picture() {
    curl -fsS -o "docs/lesion-$1.png" "$address/v1/cases/$case/$2&width=320&height=320"
}
surface='render?depth_mm=15&view=superior&zoom=2&pan=0,-25'
picture peel "$surface"
picture blur "$surface&overlay=blur"
for slice in sagittal,0 coronal,1 axial,2; do
    picture "${slice%,*}" "slices/${slice%,*}?position_mm=$(jq ".[${slice#*,}]" <<<"$place")"
done
# The right side, and the left one flipped, both with the midsagittal plane on their left.
python3 - <<'END'
from PIL import Image, ImageOps

cut = Image.open("docs/lesion-peel.png")
flipped = ImageOps.mirror(cut)
right = (cut.width // 2, 0, cut.width, cut.height)
both = Image.new(cut.mode, cut.size)
both.paste(cut.crop(right), (0, 0))
both.paste(flipped.crop(right), (cut.width // 2, 0))
both.save("docs/lesion-mirrored.png", optimize=True)
# A palette of 256 colours takes a third.
blur = Image.open("docs/lesion-blur.png").convert("RGB")
blur.quantize(256, dither=Image.Dither.NONE).save("docs/lesion-blur.png", optimize=True)
END
