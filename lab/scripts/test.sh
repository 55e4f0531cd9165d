#!/usr/bin/env bash
# Checks the laboratory: format, lints, tests, licences and advisories.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/../../scripts/lib.sh"

need_rust
lab_cargo fmt --check
lab_cargo clippy --locked --all-targets -- -D warnings
if have cargo-nextest; then
  lab_cargo nextest run --locked --no-fail-fast
else
  lab_cargo test --locked --no-fail-fast
fi
if have cargo-deny; then
  cargo deny --manifest-path lab/Cargo.toml --offline check --config deny.toml bans licenses sources
fi
advisories=${ISOCORTEX_ADVISORIES:-../shared/advisories}
[ ! -e "$advisories" ] || scripts/advisories.py "$advisories" lab/Cargo.lock
