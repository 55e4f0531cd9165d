#!/usr/bin/env bash
# Builds the server and serves a prepared head. Accepts the arguments of `isocortex demo`.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

scripts/setup.sh build
if network=$(scripts/network.sh); then
  export ISOCORTEX_NETWORK=$network
else
  say "the network's weights are not available; tree pruning extracts the brains of heads without a mask."
fi

if [ -z "${ISOCORTEX_DEMO_VOLUME:-}" ]; then
  if head=$(scripts/head.sh); then
    export ISOCORTEX_DEMO_VOLUME=$head/ch2.nii.gz
    # The network's mask is smoother than the one in the package.
    [ -n "$network" ] || export ISOCORTEX_DEMO_MASK=$head/ch2bet.nii.gz
  else
    say "no real head is available; the demo uses a synthetic head."
  fi
fi

scripts/web.sh
say "building the server (the first time takes some minutes)"
cargo build --profile demo --locked --package isocortex --bin isocortex
exec "$(target_dir)/demo/isocortex" demo "$@"
