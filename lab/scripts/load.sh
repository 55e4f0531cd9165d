#!/usr/bin/env bash
# Measures the requests per second of a separate server with Debian's wrk: meshes, paths, pictures and the list of cases, on 1, 16, 64
# and 256 connections. Server and clients share this machine. Prints a table; an answer 503 counts as an error.
# Arguments: seconds per line (3), and the greatest number of connections (256).
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/../../scripts/lib.sh"

readonly KINDS=(list mesh paths render)
readonly CONNECTIONS=(1 16 64 256)
seconds=${1:-3}
most=${2:-256}

have wrk || die "wrk is missing; install it: apt-get install wrk"
have curl || die "curl is missing."
program=${ISOCORTEX_PROGRAM:-}
if [ -z "$program" ]; then
  need_rust
  cargo build --locked -q --release --bin isocortex
  program=$(target_dir)/release/isocortex
fi
scratch=$(mktemp -d)
"$program" demo --data "$scratch/store" --listen 127.0.0.1:0 >"$scratch/said" &
server=$!
trap 'kill "$server" 2>/dev/null; wait "$server" 2>/dev/null || true; rm -rf "$scratch"' EXIT
until page=$(grep -oE 'http://[^ ]+' "$scratch/said"); do
  kill -0 "$server" 2>/dev/null || die "the server ended before its case was ready"
  sleep 0.2
done
address=${page%%/#*} case=${page##*/#}
case=${case%%&*}
# The first answers read the case from disk.
for route in mesh "render?renderer=splat"; do curl -sS -o "$scratch/warm" "$address/v1/cases/$case/$route"; done

{
  echo "request,connections,requests/s,50 % ms,99 % ms,KiB,errors"
  for kind in "${KINDS[@]}"; do
    for connections in "${CONNECTIONS[@]}"; do
      [ "$connections" -le "$most" ] || continue
      threads=$((connections < 2 ? 1 : 2))
      wrk -t "$threads" -c "$connections" -d "${seconds}s" --timeout 30s -s lab/scripts/load.lua "$address" -- "$kind" "$case" |
        tail -n 1 | sed "s/^/$kind,$connections,/"
    done
  done
} | column -s, -t
memory=$(awk '/^VmHWM/ { printf "%.0f", $2 / 1024 }' "/proc/$server/status" 2>/dev/null || true)
[ -z "$memory" ] || say "The server used at most $memory MiB."
