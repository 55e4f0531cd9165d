#!/usr/bin/env bash
# Packages the crates that are published, with the page in them, so that `cargo install isocortex` needs no Node, and builds each from its
# package. With --no-verify nothing is built. `make web` must have bundled the page.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

[ -e web/dist/manifest.json ] || die "web/dist is missing: run make web"
# The page is not in git, for which cargo asks.
git diff --quiet HEAD || die "commit what has changed, or restore it"
cargo package --workspace --exclude isocortex-tests --exclude shader-translate --locked --offline --allow-dirty "$@"
for crate in "$(target_dir)"/package/*.crate; do
  # What crates.io accepts.
  [ "$(stat -c %s "$crate")" -lt 10485760 ] || die "$crate is larger than 10 MiB"
done
