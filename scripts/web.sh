#!/usr/bin/env bash
# Bundles the page into web/dist, which the program embeds, and the widget of notebooks into the Python package; first fetches the bundler if it is missing or stale.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

if ! have node || ! have npm; then
  die "Node and npm are missing (Node 20 or later); the page is bundled with them."
fi
if ! [ web/node_modules/.package-lock.json -nt web/package-lock.json ]; then
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] ||
    die "web/node_modules is missing or stale, and ISOCORTEX_NO_INSTALL=1 forbids installing; run npm ci in web/."
  say "fetching the packages that bundle and test the page (npm ci in web/)"
  npm ci --prefix web --no-audit --no-fund --ignore-scripts --loglevel=error
fi
node web/build.mjs
