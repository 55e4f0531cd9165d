#!/usr/bin/env bash
# Builds the program, attacks it with each program of tests/faults/ (or the named ones), reports broken expectations, and prints a table
# of the figures beside their targets (lab/docs/reliability.md). Three hours for all, which end with 20 kills of the test of kills; with --short some
# minutes, for the short forms of those that have one.
# Set ISOCORTEX_BINARY to attack another program, such as an older one.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

have python3 || die "python3 is missing: the attacks are Python programs."
if [ -z "${ISOCORTEX_BINARY:-}" ]; then
  need_rust
  scripts/web.sh
  cargo build --locked --bins
  ISOCORTEX_BINARY=$(target_dir)/debug/isocortex
fi
export ISOCORTEX_BINARY
for program in caddy weed; do
  "scripts/$program.sh" >/dev/null || say "$program is missing: the attacks that need it are skipped"
done
ISOCORTEX_FAULTS_TABLE=$(mktemp)
export ISOCORTEX_FAULTS_TABLE
trap 'rm -f "$ISOCORTEX_FAULTS_TABLE"' EXIT

# Attacks that take seconds, or have a form that does.
readonly SHORT=(away compose_cluster expired_cases failing_disk flipped_bits full_disk kill_points killed_neighbour killed_workers
  kubernetes_files lost_server nginx operators power_cuts rolling_restart rolling_upgrade rsyslog same_study
  signed_in soak vanished)
words=()
if [ "${1:-}" = --short ]; then
  shift
  words=(--short)
fi
attacks=("$@")
if [ "$#" = 0 ] && [ "${#words[@]}" = 0 ]; then
  mapfile -t attacks < <(grep -lE '^ *main\(\)$' tests/faults/*.py)
elif [ "$#" = 0 ]; then
  attacks=("${SHORT[@]/#/tests/faults/}")
  attacks=("${attacks[@]/%/.py}")
fi
broken=() skipped=()
for attack in "${attacks[@]}"; do
  status=0 started=$SECONDS
  timeout 7200 python3 "$attack" "${words[@]}" || status=$?
  say "== $attack: $((SECONDS - started)) s"
  case $status in
    0) ;;
    77) skipped+=("$attack") ;;
    *) broken+=("$attack") ;;
  esac
done
if [ "$#" = 0 ] && [ "${#words[@]}" = 0 ] && have cargo; then
  attacks+=("the test of kills")
  ISOCORTEX_KILLS=20 cargo test --locked -p isocortex-tests --test it kill:: || broken+=("the test of kills")
fi
say ""
if [ -s "$ISOCORTEX_FAULTS_TABLE" ]; then
  printf '| target | asked | measured | command |\n|---|---|---|---|\n'
  cat "$ISOCORTEX_FAULTS_TABLE"
fi
for attack in "${skipped[@]}"; do say "skipped: $attack"; done
for attack in "${broken[@]}"; do say "BROKEN: $attack"; done
say "summary: $((${#attacks[@]} - ${#broken[@]} - ${#skipped[@]})) attacks held, ${#broken[@]} broken, ${#skipped[@]} skipped"
[ "${#broken[@]}" = 0 ]
