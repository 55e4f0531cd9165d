#!/usr/bin/env bash
# Builds the laboratory and runs its tests. `make test` and the continuous integration lint it and test its trial.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/../../scripts/lib.sh"

need_rust
cargo build --locked -p isocortex-bench --all-targets
if have cargo-nextest; then
  exec cargo nextest run --locked -p isocortex-bench --no-fail-fast
fi
exec cargo test --locked -p isocortex-bench --no-fail-fast
