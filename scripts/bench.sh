#!/usr/bin/env bash
# The benchmarks, one thread, release build. Arguments go to the benchmark programs (a name to filter by).
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

need_rust
scripts/web.sh
if [ -z "${ISOCORTEX_TEST_DATA:-}" ]; then
  say "ISOCORTEX_TEST_DATA is not set: benchmarks on real heads look beside the checkout, and say so if they find none."
fi
RAYON_NUM_THREADS=1 exec cargo bench --locked --workspace --benches -- "$@"
