#!/usr/bin/env bash
# Finds or fetches the demo's head: Colin27 (ch2.nii.gz) and its brain mask (ch2bet.nii.gz), from the Debian package
# mricron-data. Prints the folder that contains them, or fails and reports why. With --unpack, the package is not installed.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

readonly PACKAGE=mricron-data
readonly UNPACKED=demo-data/mricron

# The folder below $1 with both files, if there is one.
folder_below() {
  local volume
  [ -d "$1" ] || return 1
  volume=$(find "$1" -name ch2.nii.gz -print -quit 2>/dev/null)
  [ -n "$volume" ] && [ -f "$(dirname "$volume")/ch2bet.nii.gz" ] && dirname "$volume"
}

find_folder() {
  folder_below /usr/share/mricron || folder_below "$PWD/$UNPACKED"
}

# Fetches the package and unpacks it into the checkout, which needs no right to install.
unpack_package() {
  local scratch private
  { have apt-get && have dpkg-deb; } || {
    say "apt-get and dpkg-deb are needed to fetch $PACKAGE"
    return 1
  }
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || return 1
  scratch=$(mktemp -d)
  # Separate lists and caches: those of the machine may be empty, and only root may fill them.
  mkdir -p "$scratch/lists/partial" "$scratch/cache/archives/partial"
  private=(-q -o "Dir::State::Lists=$scratch/lists" -o "Dir::Cache=$scratch/cache" -o Debug::NoLocking=1
    -o APT::Sandbox::User="$(id -un)" -o Acquire::Retries=2)
  if (
    cd "$scratch"
    apt-get -q download "$PACKAGE" || { apt-get "${private[@]}" update && apt-get "${private[@]}" download "$PACKAGE"; }
  ) >"$scratch/log" 2>&1 </dev/null &&
    rm -rf "$UNPACKED.part" && mkdir -p "$(dirname "$UNPACKED")" &&
    dpkg-deb -x "$scratch/$PACKAGE"_*.deb "$UNPACKED.part" 2>>"$scratch/log" &&
    rm -rf "$UNPACKED" && mv "$UNPACKED.part" "$UNPACKED"; then
    rm -rf "$scratch"
    return 0
  fi
  say "could not fetch $PACKAGE (no network, or not in this distribution). The last output of apt:"
  tail -n 3 "$scratch/log" | sed 's/^/    /' >&2
  rm -rf "$scratch"
  return 1
}

find_folder && exit 0
if [ "${1:-}" != --unpack ] && install_right >/dev/null && install_packages "$PACKAGE"; then
  find_folder && exit 0
fi
say "fetching $PACKAGE (16 MB) into $UNPACKED"
unpack_package && find_folder
