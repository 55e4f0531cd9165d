#!/usr/bin/env bash
# Runs the benchmarks in a release build on one thread. Arguments: an action, and parts of the names of steps.
#   instructions  counts the instructions of every hot step with valgrind, prints the change from the recorded base, and fails if a
#                 step takes over 5 % more (the default if valgrind is installed)
#   record        records the counts as the base, after an intended change or with another compiler
#   times         measures the time of each step
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly BASE=lab/benches/base.tsv
readonly MOST=1.05

need_rust
what=${1:-}
[ $# = 0 ] || shift

# Builds the programs of steps and prints their paths, one per line.
programs() {
  lab_cargo bench --locked -q --bench steps --no-run --message-format=json |
    sed -nE '/"kind":\["bench"\]/s/.*"executable":"([^"]+)".*/\1/p'
}

# Whether the name $1 contains one of the other arguments, or there are none.
is_wanted() {
  local name=$1 part
  shift
  [ $# -gt 0 ] || return 0
  for part in "$@"; do [[ $name != *"$part"* ]] || return 0; done
  return 1
}

# Prints the instructions of step $2 of program $1. Fails with 2 if valgrind lacks an instruction of it.
count() {
  local out=$scratch/callgrind.out
  valgrind -q --tool=callgrind --collect-atstart=no --toggle-collect='*isocortex_counted_step*' \
    --callgrind-out-file="$out" "$1" --count "$2" >"$scratch/log" 2>&1 || {
    if grep -q 'Illegal opcode' "$scratch/log"; then
      say "not counted, because this valgrind lacks an instruction of it: $2"
      return 2
    fi
    say "valgrind failed on $2:"
    tail -n 5 "$scratch/log" >&2
    return 1
  }
  sed -nE 's/^(totals|summary): ([0-9]+).*/\2/p' "$out" | tail -n 1
}

# Prints `name TAB instructions` for each selected step.
count_all() {
  local program name instructions
  for program in $programs; do
    while read -r name; do
      is_wanted "$name" "$@" || continue
      instructions=$(count "$program" "$name") || {
        [ $? = 2 ] || exit 1
        continue
      }
      printf '%s\t%s\n' "$name" "$instructions"
    done < <("$program" --list)
  done
}

# Prints what the counts depend on besides the code.
circumstances() {
  local program
  program=$(head -n 1 <<<"$programs")
  printf '# %s; %s; %s\n' "$(rustc --version | cut -d' ' -f1-2)" "$(valgrind --version)" \
    "vectors $(valgrind -q --tool=none "$program" --vectors)"
}

compare() {
  local found=$1
  awk -F '\t' -v most="$MOST" '
    /^#/ { if (FNR == NR) recorded = $0; next }
    FNR == NR { base[$1] = $2; next }
    {
      if (!($1 in base)) { printf "%16d  %8s  %s (not in the base)\n", $2, "new", $1; next }
      ratio = $2 / base[$1]; seen++
      verdict = ratio > most ? "  SLOWER" : ""
      slower += ratio > most
      printf "%16d  %+7.2f %%  %s%s\n", $2, 100 * (ratio - 1), $1, verdict
    }
    END {
      printf "%d steps compared with the base (%s): %d take over %.0f %% more instructions\n", seen, substr(recorded, 3), slower, 100 * (most - 1)
      exit slower > 0
    }' "$BASE" "$found"
}

need_valgrind() {
  have valgrind || die "counting instructions needs valgrind; install it, or measure times: scripts/bench.sh times"
}

if [ -z "$what" ]; then
  what=instructions
  have valgrind || {
    say "valgrind is not installed, so times are measured instead of instructions."
    what="times"
  }
fi
case "$what" in
  instructions | record)
    need_valgrind
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    programs=$(programs)
    [ -n "$programs" ] || die "no program of steps was built"
    if [ "$what" = record ]; then
      [ $# = 0 ] || die "the base is recorded as a whole"
      { circumstances; count_all; } >"$scratch/base"
      mv "$scratch/base" "$BASE"
      say "recorded $(grep -vc '^#' "$BASE") steps in $BASE"
    else
      [ -f "$BASE" ] || die "there is no base in $BASE; record one: scripts/bench.sh record"
      now=$(circumstances)
      [ "$now" = "$(head -n 1 "$BASE")" ] ||
        say "the base was recorded with another setup, which may explain changes: now ${now#\# }; base $(head -n 1 "$BASE" | cut -c3-)"
      count_all "$@" >"$scratch/found"
      compare "$scratch/found"
    fi
    ;;
  times)
    lab_cargo bench --locked --bench steps
    ;;
  *) die "usage: scripts/bench.sh [instructions|record|times] [PART OF A NAME...]" ;;
esac
