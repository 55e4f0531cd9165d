#!/usr/bin/env bash
# Finds or fetches kubernetes-validate, which checks docker/kubernetes/, and with it a reader of YAML: a Python of their own in demo-data/.
# Prints its path; fails, with a word why, if it is missing and cannot be fetched.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly VERSION=1.37.0 FOLDER=demo-data/kubernetes
if ! "$FOLDER/bin/python" -c 'import kubernetes_validate, yaml' 2>/dev/null; then
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || exit 1
  have python3 || { say "python3 is missing: kubernetes-validate cannot be fetched without it"; exit 1; }
  say "fetching kubernetes-validate $VERSION into $FOLDER"
  { python3 -m venv "$FOLDER" &&
    "$FOLDER/bin/python" -m pip install -q --only-binary :all: --disable-pip-version-check "kubernetes-validate==$VERSION" >&2; } || {
    say "could not fetch kubernetes-validate $VERSION"
    rm -rf "$FOLDER"
    exit 1
  }
fi
printf '%s\n' "$PWD/$FOLDER/bin/python"
