#!/usr/bin/env bash
# Builds the program, attacks it with each program of tests/faults/ (or the named ones), reports broken expectations, and prints a table
# of the figures beside their targets (lab/docs/reliability.md). Two hours for all.
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
for program in caddy weed; do
  "scripts/$program.sh" >/dev/null || say "$program is not to be had: the attacks that need it are skipped"
done
ISOCORTEX_FAULTS_TABLE=$(mktemp)
export ISOCORTEX_FAULTS_TABLE
trap 'rm -f "$ISOCORTEX_FAULTS_TABLE"' EXIT

attacks=("$@")
if [ "$#" = 0 ]; then
  mapfile -t attacks < <(grep -lE '^ *main\(\)$' tests/faults/*.py)
fi
broken=() skipped=()
for attack in "${attacks[@]}"; do
  status=0 started=$SECONDS
  timeout 7200 python3 "$attack" || status=$?
  say "== $attack: $((SECONDS - started)) s"
  case $status in
    0) ;;
    77) skipped+=("$attack") ;;
    *) broken+=("$attack") ;;
  esac
done
say ""
if [ -s "$ISOCORTEX_FAULTS_TABLE" ]; then
  printf '| target | asked | measured | command |\n|---|---|---|---|\n'
  cat "$ISOCORTEX_FAULTS_TABLE"
fi
for attack in "${skipped[@]}"; do say "skipped: $attack"; done
for attack in "${broken[@]}"; do say "BROKEN: $attack"; done
say "summary: $((${#attacks[@]} - ${#broken[@]} - ${#skipped[@]})) attacks held, ${#broken[@]} broken, ${#skipped[@]} skipped"
[ "${#broken[@]}" = 0 ]
