#!/usr/bin/env bash
# Builds the program, attacks it with each program of tests/faults/ (or the named ones), and reports broken expectations.
# Set ISOCORTEX_BINARY to attack another program, such as an older one.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

have python3 || die "python3 is missing: the attacks are Python programs."
if [ -z "${ISOCORTEX_BINARY:-}" ]; then
  need_rust
  scripts/web.sh
  cargo build --locked --workspace --bins
  ISOCORTEX_BINARY=$(target_dir)/debug/isocortex
fi
export ISOCORTEX_BINARY

attacks=("$@")
if [ "$#" = 0 ]; then
  mapfile -t attacks < <(grep -l '^main()' tests/faults/*.py)
fi
broken=() skipped=()
for attack in "${attacks[@]}"; do
  status=0
  timeout 900 python3 "$attack" || status=$?
  case $status in
    0) ;;
    77) skipped+=("$attack") ;;
    *) broken+=("$attack") ;;
  esac
done
say ""
for attack in "${skipped[@]}"; do say "skipped: $attack"; done
for attack in "${broken[@]}"; do say "BROKEN: $attack"; done
say "summary: $((${#attacks[@]} - ${#broken[@]} - ${#skipped[@]})) attacks held, ${#broken[@]} broken, ${#skipped[@]} skipped"
[ "${#broken[@]}" = 0 ]
