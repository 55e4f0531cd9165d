#!/usr/bin/env bash
# Installs what is wanted beyond a Rust toolchain, Node and make: to build (argument: build), to test as well (test),
# or for that and the demo's head (all). What cannot be installed is named; only what nothing works without is an error.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

need_rust

# The bundled SQLite is C, and rustc links with cc.
compiler() {
  have cc || install_packages gcc libc6-dev || die "a C compiler (cc) is missing; install gcc."
}

browser() {
  scripts/chromium.sh >/dev/null && return 0
  install_packages chromium ||
    say "the browser test needs the Debian package chromium; without it that test is skipped (on CI it fails)."
}

# A graphics device in software, so that the renderers for one are tested where there is none in hardware.
graphics() {
  ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json >/dev/null 2>&1 && return 0
  install_packages libvulkan1 mesa-vulkan-drivers ||
    say "the tests of the graphics renderers need the Debian packages libvulkan1 and mesa-vulkan-drivers; without them these tests are skipped (on CI they fail)."
}

# The tests of rows start servers of their own from PostgreSQL's programs.
database() {
  if compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null || have initdb || [ -n "${ISOCORTEX_POSTGRES:-}" ]; then
    return 0
  fi
  install_packages postgresql ||
    say "the tests of PostgreSQL need the Debian package postgresql; without it these tests are skipped (on CI they fail)."
}

# The weights of the network that finds the brain.
network() {
  scripts/network.sh >/dev/null ||
    say "the network's weights are not to be had here; brains will be found by tree pruning, and the network's tests are skipped."
}

head_of_demo() {
  [ -n "${ISOCORTEX_DEMO_VOLUME:-}" ] || scripts/head.sh >/dev/null ||
    say "no real head is to be had here; the demo will take a phantom head instead."
}

case "${1:-all}" in
  build) compiler ;;
  test) compiler; browser; graphics; database; network ;;
  all) compiler; browser; graphics; database; network; head_of_demo ;;
  *) die "usage: scripts/setup.sh [build|test|all]" ;;
esac
