#!/usr/bin/env bash
# Finds or makes the environment in which the Python package is tested: a Python of its own in demo-data/, with the packages of
# python/requirements-test.txt. Prints its path; fails, with a word why, if it is missing and cannot be made.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly NEEDED=python/requirements-test.txt FOLDER=demo-data/python
if ! cmp -s "$NEEDED" "$FOLDER/installed.txt"; then
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || exit 1
  python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { say "the tests of the Python package need Python 3.11"; exit 1; }
  say "fetching the packages of $NEEDED into $FOLDER"
  rm -rf "$FOLDER"
  { python3 -m venv "$FOLDER" &&
    "$FOLDER/bin/python" -m pip install -q --only-binary :all: --disable-pip-version-check -r "$NEEDED" >&2; } || {
    say "could not fetch the packages of $NEEDED"
    rm -rf "$FOLDER"
    exit 1
  }
  cp "$NEEDED" "$FOLDER/installed.txt"
fi
printf '%s\n' "$PWD/$FOLDER/bin/python"
