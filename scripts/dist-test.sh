#!/usr/bin/env bash
# Tests what `make dist` has made, as somebody who gets it: dist-walk.sh, where nothing of Isocortex was ever installed, without a network.
#
#   scripts/dist-test.sh [archive|wheel|bookworm|trixie|image]    by default all of these
#
# The package is installed in a fresh Debian, which systemd boots (systemd-nspawn); that needs root. The image is IMAGE, or the one that Docker builds
# of the archive; without Docker, buildah builds it and no container engine runs it. The seconds are those since the walk began.
set -euo pipefail
# shellcheck source=scripts/lib.sh
. "$(dirname "$0")/lib.sh"

dist=$(target_dir)/dist
work=$(target_dir)/dist-test
golden=$(cat tests/golden/colin27-left-12mm.sha256)
failed=()
mkdir -p "$work"

# The digest of the pixels of a PNG: its texts name the version.
digest() {
  python3 - "$1" <<'E1'
import hashlib, sys, zlib
png, at, header, pixels = open(sys.argv[1], "rb").read(), 8, b"", b""
while at < len(png):
    size, kind = int.from_bytes(png[at : at + 4], "big"), png[at + 4 : at + 8]
    header += png[at + 8 : at + 8 + size] if kind == b"IHDR" else b""
    pixels += png[at + 8 : at + 8 + size] if kind == b"IDAT" else b""
    at += 12 + size
print(hashlib.sha256(header + zlib.decompress(pixels)).hexdigest())
E1
}

# Each picture of a walk is the golden one, byte for byte.
compare() {
  local name=$1 picture found=0
  for picture in "$work/$name"/out/*.png; do
    [ -e "$picture" ] || break
    found=$((found + 1))
    [ "$(digest "$picture")" = "$golden" ] || { say "$name: $picture is another picture"; return 1; }
  done
  say "== $name: $found pictures are as they should be"
  [ "$found" -ge 2 ]
}

one() { compgen -G "$dist/$1" || die "$dist has no $1, or several: run make dist"; }

# An empty folder and no network; the home cannot be written.
walk() {
  local kind=$1 file=$2
  rm -rf "${work:?}/$kind"
  mkdir -p "$work/$kind/folder"
  (cd "$work/$kind/folder" && env HOME=/nonexistent unshare --net -- sh -c 'ip link set lo up && exec "$@"' - \
    "$OLDPWD/scripts/dist-walk.sh" "$kind" "$file" "$work/$kind/out")
}

# The oldest Python that is installed, because the wheel must need none in particular.
oldest_python() {
  local minor
  for minor in 8 9 10 11 12 13 14; do
    "python3.$minor" -c '' 2>/dev/null && { command -v "python3.$minor"; return; }
  done
  command -v python3
}

booted() {
  local suite=$1 file=$2 archive=$3 tree=$work/$1/tree
  # The keys are there on Debian, but not on Ubuntu.
  { have mmdebstrap && have systemd-nspawn; } || install_packages mmdebstrap systemd-container debian-archive-keyring
  [ -e "$work/$suite.tar" ] || {
    say "making a Debian $suite"
    mmdebstrap --quiet --variant=minbase --include=systemd,systemd-sysv,dbus,adduser,curl,procps "$suite" "$work/part.$suite.tar" &&
      mv "$work/part.$suite.tar" "$work/$suite.tar"
  }
  rm -rf "${work:?}/$suite"
  mkdir -p "$tree/root/out"
  tar -C "$tree" -xf "$work/$suite.tar"
  cp "$file" "$archive" scripts/dist-walk.sh "$tree/root/"
  cat >"$tree/etc/systemd/system/walk.service" <<E2
[Unit]
After=multi-user.target
[Service]
Type=oneshot
ExecStart=/bin/bash /root/dist-walk.sh deb /root/$(basename "$file") /root/out
ExecStopPost=/bin/systemctl --no-block poweroff
StandardOutput=file:/root/out/said.txt
StandardError=file:/root/out/said.txt
E2
  mkdir -p "$tree/etc/systemd/system/multi-user.target.wants"
  ln -s ../walk.service "$tree/etc/systemd/system/multi-user.target.wants/"
  # Neither this machine's systemd nor its network is needed.
  SYSTEMD_NSPAWN_UNIFIED_HIERARCHY=1 timeout 900 systemd-nspawn --quiet --directory="$tree" --private-network --register=no --keep-unit \
    --boot >"$work/$suite/boot.txt" 2>&1 </dev/null || true
  mv "$tree/root/out" "$work/$suite/out"
  cat "$work/$suite/out/said.txt"
  grep -q 'removed; done' "$work/$suite/out/said.txt" || { tail -n 5 "$work/$suite/boot.txt"; return 1; }
  rm -rf "$tree"
}

image() {
  rm -rf "${work:?}/image"
  mkdir -p "$work/image/out"
  if docker info >/dev/null 2>&1; then
    [ -n "${IMAGE-}" ] || docker build --file docker/Dockerfile --build-arg PROGRAM=archive --tag "${IMAGE:=isocortex}" .
    scripts/dist-walk.sh image "$IMAGE" "$work/image/out"
  else
    { have buildah && have debootstrap; } || install_packages buildah debootstrap
    python3 tests/faults/built_image.py --archive "$work/image/out"
  fi
}

[ "$(id -u)" = 0 ] || [ "${1-}" = image ] || die "systemd-nspawn and namespaces of the network need root"
case ${1-} in
  archive) walk archive "$(one '*.tar.gz')" ;;
  wheel)
    export PYTHON=${PYTHON:-$(oldest_python)} WHEELS=$work/wheels
    "$PYTHON" -m venv --clear "$work/fetch"
    "$work/fetch/bin/pip" download --quiet --disable-pip-version-check --only-binary :all: --dest "$WHEELS" "$(one '*.whl')"
    walk wheel "$(one '*.whl')"
    ;;
  image) image ;;
  bookworm | trixie) booted "$1" "$(one '*.deb')" "$(one '*.tar.gz')" ;;
  *)
    for name in archive wheel bookworm trixie image; do "$PWD/scripts/dist-test.sh" "$name" || failed+=("$name"); done
    [ "${#failed[@]}" = 0 ] || die "failed: ${failed[*]}"
    exit 0
    ;;
esac
compare "$1"
